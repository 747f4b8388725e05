// What the theme leaves without a name for those who listen to the page.
const named = () => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document.querySelectorAll(".md-code__nav").forEach((buttons, k) => buttons.setAttribute("aria-label", `Code ${k + 1}`));
  for (const choice of document.querySelectorAll("input[data-md-color-media]")) choice.setAttribute("aria-label", choice.dataset.mdColorMedia.match(/light|dark/)?.[0] || "as the system");
};
named();
new MutationObserver(named).observe(document.body, { childList: true, subtree: true });
