"""Notebook theme: figures of a notebook turn dark with JupyterLab, also when its theme changes later.

Python does not know the theme of the page. JupyterLab notes it on the page's body, where the figure looks as
soon as it has a size. Panel takes the colour of texts and labels of widgets from a variable that only the
package ipywidgets defines: without it they are black, also in the dark. The figure defines it.
"""

from __future__ import annotations

from typing import Any

from bokeh.models import CustomJS
from bokeh.plotting import figure

FOLLOW = """
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
"""
"""Turns the lightness of a figure and keeps its hues; white becomes the dark grey of JupyterLab's cells."""
_EVENT = "change:inner_width"


def follow_theme(drawn: figure) -> None:
    """Have a figure turn dark where JupyterLab is dark; elsewhere nothing changes.

    Parameters
    ----------
    drawn
        The figure, which no page shows yet.
    """
    if _EVENT not in drawn.js_property_callbacks:
        drawn.js_on_change("inner_width", CustomJS(code=FOLLOW))


def theme_hook(plot: Any, element: Any) -> None:
    """Do the same with a plot of HoloViews, as one of its ``hooks``."""
    follow_theme(plot.state)
