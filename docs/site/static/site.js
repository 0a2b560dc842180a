/* What scrolls by itself can be reached with the keyboard. */
const scrolling = ".equation, .output, .bd-article table, .bd-article dt.sig";

function reach() {
  for (const part of document.querySelectorAll(scrolling)) {
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
    else part.removeAttribute("tabindex");
  }
}

addEventListener("load", reach);
addEventListener("resize", reach);
