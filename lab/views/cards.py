"""Cards: what notebooks show of the lab's objects, and what these offer there, registered by name.

`import lab` registers them. To keep that fast, a function is imported when it is first used.
"""

from __future__ import annotations

from lab.base.registry import register

CARDS = {
    "settings": "lab.views.result_cards:settings_html",
    "result": "lab.views.result_cards:result_html",
    "mission": "lab.views.mission_card:mission_html",
    "log": "lab.views.mission_card:log_html",
    "import report": "lab.views.mission_card:import_report_html",
    "outcome": "lab.views.result_cards:outcome_html",
    "verdict": "lab.views.ensemble_cards:verdict_html",
    "foreign verdict": "lab.views.foreign_filter:foreign_html",
    "comparison": "lab.views.ensemble_cards:comparison_html",
    "ensemble": "lab.views.ensemble_cards:ensemble_html",
    "sensor card": "lab.views.result_cards:sensor_html",
    "sweep": "lab.views.sweep_plot:sweep_html",
    "outages": "lab.views.outage_view:outages_html",
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
    register("sweep", "json", "lab.experiment.json_form:sweep_json")
    register("ensemble", "json", "lab.experiment.json_form:ensemble_json")
    register("figure", "note", "lab.views.paper_figure:note")
    register("result", "view3d", "lab.views.scene:view3d")
    register("result", "explore", "lab.views.explorer:explore")
    register("result", "json", "lab.experiment.json_form:result_to_json")
    register("result", "report", "lab.views.report:write_report")
    register("experiment", "sweep", "lab.experiment.ensembles.sweeping:sweep")
    register("experiment", "outage", "lab.experiment.ensembles.outages:outage")
    register("experiment", "ensemble", "lab.experiment.ensembles.seeds:run_ensemble")
    register("experiment", "progress", "lab.views.notebook_display:shown")
