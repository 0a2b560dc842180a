"""Page template: the HTML of the page, the script that makes Bokeh quick, and the link past the settings."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment

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

PAGE = Environment().from_string(
    f"""
{{% extends base %}}
{{% block postamble %}}{{{{ super() }}}}
<script>
window.insLabOpened = window.location.search;  // for history_bar.js
{{% raw %}}{SCRIPT.read_text()}{{% endraw %}}
</script>
{{% endblock %}}
{{% block contents %}}
{SKIP}
{{{{ super() }}}}
{{% endblock %}}
"""
)
"""Panel's page, with a script after those of Bokeh and before the one that makes the page."""
