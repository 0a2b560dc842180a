/* What scrolls by itself can be reached with the keyboard, and sliders and boxes of a notebook say their names. */
const scrolling = ".equation, .output, .bd-article table, .bd-article dt.sig";

function reach() {
  for (const part of document.querySelectorAll(scrolling)) {
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
    else part.removeAttribute("tabindex");
  }
}

function nameWidgets(root) {
  for (const part of root.querySelectorAll("*")) {
    if (part.shadowRoot) nameWidgets(part.shadowRoot);
    if (part.matches(".noUi-handle"))
      part.setAttribute("aria-label", root.querySelector(".bk-slider-title")?.textContent || "slider");
    if (part.matches("input[type=checkbox]"))
      part.setAttribute("aria-label", part.nextElementSibling?.textContent.trim() || "switch");
  }
}

const grown = new ResizeObserver((changes) => {
  for (const change of changes) nameWidgets(change.target);
  reach();
});

addEventListener("load", () => {
  reach();
  for (const output of document.querySelectorAll(".output")) grown.observe(output);
});
addEventListener("resize", reach);
