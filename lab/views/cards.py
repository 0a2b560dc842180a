"""Cards: what notebooks show of the lab's objects, and what these offer there, registered by name.

`import lab` registers them. To keep that fast, a function is imported when it is first used.
"""

from __future__ import annotations

from lab.base.registry import register

CARDS = {
    "settings": "lab.views.settings_card:settings_html",
    "result": "lab.views.result_card:result_html",
    "mission": "lab.views.mission_card:mission_html",
    "log": "lab.views.mission_card:log_html",
    "import report": "lab.views.import_report_card:import_report_html",
    "outcome": "lab.views.outcome_card:outcome_html",
    "verdict": "lab.views.verdict_card:verdict_html",
    "comparison": "lab.views.comparison_card:comparison_html",
    "ensemble": "lab.views.ensemble_card:ensemble_html",
    "sensor card": "lab.views.sensor_card:sensor_html",
    "sweep": "lab.views.sweep_card:sweep_html",
}
"""The functions that draw the cards."""
PLOTS = (
    "errors",
    "covariance",
    "innovations",
    "consistency",
    "sensor_errors",
    "ground_track",
    "height",
)
"""The plots of a result, by their functions in `lab.views.plots`; the first is its default plot."""


def register_cards() -> None:
    """Register all cards, plots and views."""
    for card, function in CARDS.items():
        register("card", card, function)
    for plot in PLOTS:
        register("plot", plot, f"lab.views.plots:{plot}")
    register("sweep", "plot", "lab.views.sweep_plot:sweep_plot")
    register("result", "view3d", "lab.views.framed_scene:view3d")
    register("result", "explore", "lab.views.explorer:explore")
    register("experiment", "sweep", "lab.experiment.ensembles.sweeping:sweep")
    register("experiment", "progress", "lab.views.notebook_progress:shown")
