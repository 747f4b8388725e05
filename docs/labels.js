// What the theme leaves without a name for those who listen to the page.

// The choices of colours: the theme's one visible label is for the choice that follows,
// the others' labels are hidden.
const nameChoices = (colours) => {
  if (colours.querySelector("[role=radiogroup]")) return;
  const group = document.createElement("div");
  group.style.display = "contents";
  group.setAttribute("role", "radiogroup");
  group.setAttribute("aria-label", "Colours");
  group.append(...colours.childNodes);
  colours.append(group);
  for (const choice of colours.querySelectorAll("input"))
    choice.setAttribute(
      "aria-label",
      choice.dataset.mdColorMedia.match(/light|dark/)?.[0] || "as the system",
    );
  for (const label of colours.querySelectorAll("label[for]")) {
    const choice = document.getElementById(label.htmlFor);
    label.removeAttribute("for");
    label.addEventListener("click", () => choice.click());
  }
};

const named = () => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document
    .querySelectorAll(".md-code__nav")
    .forEach((buttons, k) => buttons.setAttribute("aria-label", `Code ${k + 1}`));
  const colours = document.querySelector("[data-md-component=palette]");
  if (colours) nameChoices(colours);
};
named();
new MutationObserver(named).observe(document.body, { childList: true, subtree: true });
