"""Plots in a notebook: a lab's plot is shown as one where the notebook called ``pn.extension()`` alone."""

from __future__ import annotations

import subprocess
import sys

import pytest

NOTEBOOK = """
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
for cell in ("import panel as pn; from lab import plots; pn.extension()", "plots.use_bokeh()"):
    shell.run_cell(cell)
import holoviews as hv
shown, _ = shell.display_formatter.format(hv.Layout([hv.Curve([1, 2])]))
print("SHOWN AS", *shown)
"""


@pytest.mark.proof
def test_a_layout_is_shown_as_a_plot_and_not_as_its_name() -> None:
    done = subprocess.run([sys.executable, "-c", NOTEBOOK], capture_output=True, text=True, check=True)
    (shown,) = (line for line in done.stdout.splitlines() if line.startswith("SHOWN AS"))
    assert "text/html" in shown
