"""Page template: the HTML of the page, with the script that makes Bokeh quick in the browser."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment

SCRIPT = Path(__file__).with_name("upstream") / "upstream.js"

PAGE = Environment().from_string(
    f"""
{{% extends base %}}
{{% block postamble %}}{{{{ super() }}}}
<script>
{{% raw %}}{SCRIPT.read_text()}{{% endraw %}}
</script>
{{% endblock %}}
"""
)
"""Panel's page, with a script after those of Bokeh and before the one that makes the page."""
