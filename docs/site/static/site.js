/* What scrolls by itself can be reached with the keyboard, and each slider of a notebook says its name. */
const scrolling = ".equation, .output, .bd-article table, .bd-article dt.sig";

function reach() {
  for (const part of document.querySelectorAll(scrolling)) {
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
    else part.removeAttribute("tabindex");
  }
}

function nameSliders(root) {
  for (const part of root.querySelectorAll("*")) {
    if (part.shadowRoot) nameSliders(part.shadowRoot);
    if (part.matches(".noUi-handle"))
      part.setAttribute("aria-label", root.querySelector(".bk-slider-title")?.textContent || "slider");
  }
}

const grown = new ResizeObserver((changes) => {
  for (const change of changes) nameSliders(change.target);
  reach();
});

addEventListener("load", () => {
  reach();
  for (const output of document.querySelectorAll(".output")) grown.observe(output);
});
addEventListener("resize", reach);
