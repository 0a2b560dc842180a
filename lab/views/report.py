"""Report: a run as one HTML file, which opens without a network, prints on few pages, and repeats the run.

It holds the verdict, the settings that differ, plots of errors, innovations and path, tables, all settings as
TOML, and the versions that made it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bokeh.embed import components
from bokeh.models.annotations import Title
from bokeh.plotting import figure
from bokeh.resources import Resources

from lab.base.files.atomic_file import write_file
from lab.base.result_files import refuse_existing
from lab.run.provenance import facts_block
from lab.views.ensemble_cards import scroll_box, verdict_html
from lab.views.figures import TimeAxis
from lab.views.quantities import CONSISTENCY, ERRORS, HEIGHT, INNOVATIONS, SENSOR_ERRORS
from lab.views.report_scene import STYLE, scene_html
from lab.views.result_cards import settings_html
from lab.views.time_figures import TimeFigures
from lab.views.time_plot import TimePlot
from lab.views.track import TrackFigure

if TYPE_CHECKING:
    import pandas as pd

    from lab.experiment.result import Result

BUCKETS = 330
"""Number of intervals to which each curve is thinned: one for each pixel of a plot."""
WIDTH, LINE = 330, 205
"""Width of a plot, and height of a line of three [px]."""

_STYLE = Path(__file__).with_name("report.css").read_text("utf-8")


def report_html(result: Result, notes: Sequence[tuple[float, float, str]] = ()) -> str:
    """Return a run as one HTML file.

    The advice of its verdict is tried, which takes some runs.

    Parameters
    ----------
    result
        The run. Of a homework, nothing that is hidden is in the report.
    notes
        Notes on the flight: start and end [s], and a text, which is never taken as markup.
    """
    mission = result.mission.title or result.mission.name
    groups = dict(_plots(result, [(start, end) for start, end, _ in notes]))
    figures = [one for group in groups.values() for one in group]
    scripts, places = components(figures)
    drawn = iter(places)
    plots = "".join(
        f'<h2>{escape(title)}</h2><div class="plots">{"".join(next(drawn) for _ in group)}</div>'
        for title, group in groups.items()
        if group
    )
    facts = result.facts
    shown = ", ".join(part for part in (f"{result.time[-1]:.0f} s", result.realisation) if part)
    algorithm = f" Navigated by {escape(result.algorithm)}." if result.algorithm else ""
    remarks = "".join(f"<li>{escape(remark)}</li>" for remark in result.remarks)
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{escape(mission)}: INS Lab</title><style>{_STYLE}{STYLE}</style>"
        f"{_bokeh()}</head><body>"
        f'<h1>{escape(mission)}</h1><p class="quiet">{escape(shown)}.{algorithm} '
        f"{escape(_versions(facts))}</p>"
        f"{verdict_html(result.tried_verdict)}{f'<ul>{remarks}</ul>' if remarks else ''}"
        f"<h2>Settings that differ</h2>{settings_html(result.experiment, changed_only=True)}"
        f"{_notes(notes)}{plots}<h2>In three dimensions</h2>{scene_html(result)}"
        f'<h2>Tables</h2><div class="tables">{"".join(_tables(result))}</div>'
        f"{_repetition(result, facts)}{scripts}</body></html>"
    )


def write_report(
    result: Result, path: Path, *, overwrite: bool = False, notes: Sequence[tuple[float, float, str]] = ()
) -> None:
    """Write a run as one HTML file; see `Result.report`."""
    refuse_existing([path], overwrite)
    last = float(result.time[-1])
    for start, end, text in notes:
        if not 0 <= start <= end <= last:
            raise ValueError(
                f"the note {text!r} is from {start:g} s to {end:g} s: accepted is 0 <= start <= end, and the "
                f"flight lasts {last:.1f} s"
            )
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: there is no folder {path.parent}")
    html = report_html(result, notes)
    write_file(path, html)


def _bokeh() -> str:
    """Return Bokeh's own script; what its extensions add, as where Panel is loaded, is not needed."""
    return "".join(f"<script>{js}</script>" for js in Resources(mode="inline", components=["bokeh"]).js_raw)


def _notes(notes: Sequence[tuple[float, float, str]]) -> str:
    """Return the list of the notes; empty without any."""
    rows = "".join(
        f"<li>{f'{start:.1f} s' if start == end else f'{start:.1f} to {end:.1f} s'}: {escape(text)}</li>"
        for start, end, text in notes
    )
    return f'<h2>Notes on the flight</h2><ul id="notes">{rows}</ul>' if rows else ""


def _plots(result: Result, shaded: Sequence[tuple[float, float]]) -> Iterator[tuple[str, list[figure]]]:
    """Iterate over the titles of the groups of plots, and their figures."""
    axis = TimeAxis(name="report")
    axis.span(float(result.time[-1]))
    outages = result.experiment.sensors.gps.outages
    axis.show_outages([(start - result.epoch, end - result.epoch) for start, end in outages])
    axis.show_notes(shaded)
    if not result.missing_reason("errors"):
        yield "Errors, with ±3σ of the filter", _draw_figures(ERRORS, axis, result)
    yield "Innovations, with ±3σ of the filter", _draw_figures(INNOVATIONS, axis, result)
    yield "Consistency, with the band of 95 % of a matched filter", _draw_figures(CONSISTENCY, axis, result)
    truth = ", and the truth" if result.recorded is None else ""
    yield f"Biases: the estimate with ±3σ{truth}", _draw_figures(SENSOR_ERRORS, axis, result)
    track = TrackFigure()
    track.show(result, 0.0)
    track.figure.toolbar_location = None
    yield "Path", [_set_height(track.figure, 2 * LINE), *_draw_figures((HEIGHT[0], HEIGHT[2]), axis, result)]


def _draw_figures(plots: Sequence[TimePlot], axis: TimeAxis, result: Result) -> list[figure]:
    """Return the figures of those plots that have something to show."""
    figures = TimeFigures(plots, axis, buckets=BUCKETS)
    figures.show(result)
    return [_set_height(fig) for fig in figures.figures if fig.visible]


def _set_height(fig: figure, height: int = LINE) -> figure:
    fig.update(sizing_mode=None, min_height=None, width=WIDTH, height=height, outline_line_color=None)
    fig.axis.minor_tick_line_color = None
    assert isinstance(fig.title, Title)
    fig.title.update(text_font_size="11px", text_font_style="normal", text_font="Roboto, Arial, sans-serif")
    return fig


def _tables(result: Result) -> Iterator[str]:
    """Iterate over the tables of errors, of errors in their σ, and of innovations in theirs."""
    if not result.missing_reason("summary"):
        yield _table(result.summary, "Errors")
    if not result.missing_reason("coverage"):
        yield _table(result.coverage, "Errors in their σ")
    yield _table(result.whiteness, "Innovations")


def _table(table: pd.DataFrame, label: str) -> str:
    html = table.to_html(index=False, border=0, float_format=lambda value: f"{value:.3g}", na_rep="–")
    return scroll_box(str(html), label)


def _versions(facts: Mapping[str, Any]) -> str:
    made = facts["made"].replace("T", " ").removesuffix("Z")
    used = {**facts["versions"], "bokeh": version("bokeh")}
    return f"Made on {made} UTC with {', '.join(f'{name} {one}' for name, one in used.items())}."


def _repetition(result: Result, facts: Mapping[str, Any]) -> str:
    """Return all settings, how the run is repeated with them, and what `lab.open_result` reads."""
    name = result.experiment.mission
    made = {name: value for name, value in facts.items() if name != "settings"}
    if result.experiment.hidden:
        how = "Some settings of this run are hidden, so the settings below do not repeat it."
    else:
        how = (
            "Save the settings below as <code>settings.toml</code>, and run "
            f"<code>ins-lab run {escape(name)} --config settings.toml</code>. On processors of one family, "
            "it gives the same figures to the last bit. <code>lab.open_result</code> of this file does so in "
            "Python."
        )
    if result.algorithm:
        how += " The run was made by an algorithm of its own, which is not in this report."
    return (
        f"<h2>Repeat this run</h2><p>{how} SHA-256 of the recording: "
        f"<code>{escape(result.mission.content_hash)}</code>.</p>"
        f'<pre id="settings">{escape(result.experiment.to_toml())}</pre>'
        f'<pre id="origin">\n{escape(facts_block(made))}</pre>'
    )
