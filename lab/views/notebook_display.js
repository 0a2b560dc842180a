const view = Bokeh.index.find_one(cb_obj);
if (view == null || view.el.dataset.followsTheme) return;
view.el.dataset.followsTheme = "yes";
const colour = "--jp-widgets-label-color";
if (document.body.dataset.jpThemeLight && !getComputedStyle(document.body).getPropertyValue(colour))
  document.body.style.setProperty(colour, "var(--jp-ui-font-color1)");
const dress = () => {
  const dark = document.body.dataset.jpThemeLight === "false";
  view.el.style.filter = dark ? "invert(0.92) hue-rotate(180deg)" : "";
};
new MutationObserver(dress).observe(document.body, {attributeFilter: ["data-jp-theme-light"]});
dress();
