"""Page template: the frame of the page, its HTML, the script that makes Bokeh quick, a link to the plots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import panel as pn
from jinja2 import Environment
from panel_material_ui.template.base import Page as MaterialPage
from param.parameterized import edit_constant

from dashboards.style import DRESS, THEME
from dashboards.upstream.components import material_bundle
from dashboards.upstream.server import leave_out_hooks

SCRIPT = Path(__file__).with_name("upstream") / "upstream.js"

SKIP = """
<style>
  .skip-link { position: fixed; top: 4px; left: 8px; z-index: 2000; padding: 8px 16px; border-radius: 6px;
               font: 500 15px/1.4 Roboto, Arial, sans-serif; background: #ffffff; color: #16324f;
               outline: 3px solid #f0a050; }
  .skip-link:not(:focus) { transform: translateY(-200%); }
  @media print { .skip-link { display: none; } }
</style>
<a class="skip-link" href="#{{ docs[0].roots[0].elementid }}">Skip to the plots</a>
<script>
  document.querySelector(".skip-link").addEventListener("click", (event) => {
    event.preventDefault();
    const named = (name) => Array.from(Bokeh.index.query(({model}) => model.name === name))[0]?.el;
    const place = ["page Missions", "page stage"].map(named).find((el) => el?.checkVisibility());
    if (!place) return;
    for (const [name, value] of [["tabindex", -1], ["role", "tabpanel"], ["aria-label", "Plots"]]) {
      place.setAttribute(name, value);
    }
    place.focus();
  });
</script>
"""
"""The first thing that a key reaches; it leads to what is open: the tab, or the sheet that covers it.

A panel of a tab hears the keys of the page, as Space; see ``history_bar.js``.
"""

ALERT = """
window.insLabAlert = (words, label = "Reload", act = () => window.location.reload()) => {
  const box = document.createElement("div");
  box.setAttribute("role", "alert");
  Object.assign(box.style, {
    position: "fixed", top: 0, left: 0, right: 0, bottom: "auto", width: "auto", margin: 0, border: 0,
    padding: "10px 16px", display: "flex", flexWrap: "wrap", gap: "8px 16px", alignItems: "center",
    background: "#b3261e", color: "#ffffff", font: "16px/1.4 Roboto, Arial, sans-serif",
  });
  box.append(words);
  const button = document.createElement("button");
  button.append(label);
  Object.assign(button.style, {
    padding: "6px 14px", border: 0, borderRadius: "4px", background: "#ffffff", color: "#8c1d18",
    font: "inherit", cursor: "pointer",
  });
  button.addEventListener("click", () => act(box));
  box.append(button);
  document.body.append(box);
  box.popover = "manual";
  box.showPopover?.();
  return box;
};
"""
"""Shows a line above all else, the open settings of a phone too, with a button: it loads the page again."""

SHIMS, WEB_GL = "/es-module-shims.min.js", "/bokeh-gl.min.js"
"""Scripts that Panel has every page load and none of the laboratory needs: browsers import modules by
themselves, see ``upstream.js``, and no plot is drawn with WebGL."""

PAGE = Environment().from_string(
    f"""
{{% extends base %}}
{{% block js_resources %}}
<link rel="modulepreload" href="{{{{ bundle() }}}}">
{{% for line in bokeh_js.splitlines() if not ("{SHIMS}" in line or "{WEB_GL}" in line) %}}{{{{ line }}}}
{{% endfor %}}
{{% endblock %}}
{{% block postamble %}}{{{{ super() }}}}
<script>
window.insLabOpened = window.location.search;  // for history_bar.js
{{% raw %}}{ALERT}{SCRIPT.read_text()}{{% endraw %}}
</script>
{{% endblock %}}
{{% block contents %}}
{SKIP}
{{{{ super() }}}}
{{% endblock %}}
""",
    globals={"bundle": material_bundle},
)
"""Panel's page, with a script after those of Bokeh and before the one that makes the page.

The code of the components, a third of all, is on its way before the page names it.
"""


def page_frame(
    header: Sequence[pn.viewable.Viewable],
    sidebar: pn.viewable.Viewable,
    main: pn.viewable.Viewable,
) -> MaterialPage:
    """Return the frame of the page with what stands in it."""
    frame = MaterialPage(
        title="INS Lab",
        header=[*header],
        sidebar=[sidebar],
        sidebar_width=330,
        main=[main],
        theme_config=THEME,
        sx=DRESS,
        busy_indicator=None,
        template=PAGE,
    )
    _unlink_busy(frame)
    leave_out_hooks(frame)
    return frame


def _unlink_busy(frame: MaterialPage) -> None:
    """Unlink a frame from the busy state of the server.

    A linked frame is visited at every event of any session, and is never freed.
    """
    with edit_constant(frame):
        frame.busy = False
    for watcher in list(pn.state.param.watchers["busy"]["value"]):
        if getattr(getattr(watcher.fn, "__self__", None), "self", None) is frame:
            pn.state.param.unwatch(watcher)
