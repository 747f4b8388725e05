// What the theme leaves without a name for those who listen to the page.
const named = () => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  for (const buttons of document.querySelectorAll(".md-code__nav:not([role])")) buttons.setAttribute("role", "group");
};
named();
new MutationObserver(named).observe(document.body, { childList: true, subtree: true });
