"""Allan: the simulated output of the sensors at rest, and the noise terms fitted to it."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import NamedTuple

import numpy as np
import panel as pn

from dashboards.pages.base import plot_grid
from dashboards.pages.computed import ComputedPage
from dashboards.pages.rest_upload import RestRecording, RestUpload
from dashboards.pages.summary import TABLE_STYLE
from dashboards.style import plain_column, wide_html
from lab.analysis import allan, rest
from lab.base.parameters.settings import Settings
from lab.base.progress import Progress
from lab.experiment.result import Result
from lab.sensors.cards import card_in_force
from lab.views.allan import TITLES, AllanFigures
from lab.views.ensemble_cards import scroll_box

LEAST_REST = 10.0
"""Shortest rest at the start of a log for an Allan deviation [s]."""

WORDS = {
    "noise_density": "White noise N",
    "flicker": "Bias instability B",
    "rate_random_walk": "Random walk K",
    "quantisation_noise": "Quantisation noise Q",
    "rate_ramp": "Ramp R",
}


TABLE = 460
"""Height of the table and the words [px]."""


class AtRest(NamedTuple):
    """Allan deviation, fitted terms and length [s] of each triad's record, and the upload they are of."""

    deviations: dict[str, allan.AllanDeviation]
    terms: dict[str, allan.NoiseTerms]
    durations: dict[str, float]
    recording: RestRecording | None


class Allan(ComputedPage):
    """Allan deviation of the simulated sensors at rest, or of a recording, with the settings' own values."""

    title = "Allan"
    contents = "the Allan deviation of the sensors at rest"
    over_time = False
    working = "Simulating the sensors at rest …"

    def make(self) -> pn.viewable.Viewable:
        """Return two figures and a table."""
        self._figures = AllanFigures()
        self._table = wide_html(margin=(4, 20), stylesheets=[TABLE_STYLE])
        self._upload = RestUpload(self._take)
        return plain_column(
            self.words,
            self._upload.view,
            plot_grid(self._figures.figures, 2, least=380, beside=TABLE),
            self._table,
        )

    @classmethod
    def missing_reason(cls, result: Result) -> str:
        """Return why a sensor log has no Allan deviation: its rest is too short."""
        if result.recorded is None or result.recorded.alignment.rest >= LEAST_REST:
            return ""
        return (
            f"An Allan deviation needs sensors at rest for {LEAST_REST:g} s or more. This sensor log starts "
            f"with {result.recorded.alignment.rest:.0f} s of rest."
        )

    def work_out(self, result: Result, _progress: Progress) -> AtRest:
        """Simulate the sensors at rest, and fit their output; for a log, fit its beginning."""
        recording = self._upload.recording
        records: Mapping[str, rest.Record]
        if recording is not None:
            records = recording.records
        elif result.recorded is None:
            records = rest.simulate(result.experiment.sensors, result.experiment.seed)
        else:
            records = rest.of_log(result.recorded.log, result.recorded.alignment.rest)
        deviations = {triad: allan.deviation(record.rates, record.dt) for triad, record in records.items()}
        return AtRest(
            deviations,
            rest.noise_terms(records),
            {triad: record.duration for triad, record in records.items()},
            recording,
        )

    def _take(self) -> None:
        """Draw another recording, or the sensors of the settings again."""
        self._content = self._wanted = None
        self.draw_again()

    def close(self) -> None:
        """Delete what was uploaded, and end the computation."""
        self._upload.close()
        super().close()

    def clear(self) -> None:
        """Draw nothing."""
        self._figures.clear()
        self._table.object = ""

    def paint(self, result: Result, content: AtRest) -> str:
        """Draw the deviations, and fill the table of terms."""
        sensors = result.experiment.sensors
        self._figures.show(sensors, content.deviations)
        self._table.object = terms_html(result, content)
        poor = escape(rest.about_fit(content.terms))
        if content.recording is not None:
            length = max(content.durations.values())
            remarks = escape(" ".join(content.recording.records.remarks))
            return (
                f"{escape(content.recording.name)}: {length:.0f} s at rest. Dashed lines and the columns "
                f"'set' are the sensors of the settings. {remarks} {poor}"
            ).rstrip()
        if result.recorded:
            return (
                f"The sensor log, {content.durations['gyro']:.0f} s at rest. Dashed lines and the columns "
                f"'set' are what the filter assumes about the sensors. {poor}"
            ).rstrip()
        gyro, accelerometer = (f"{content.durations[triad] / 3600:.3g} h" for triad in TITLES)
        times = f"{gyro} (gyros) and {accelerometer} (accelerometers)" if gyro != accelerometer else gyro
        name = card_in_force(sensors) or "Own settings, no card"
        return (
            f"{escape(name)}: simulated at rest for {times}. {escape(sensors.card_remark())} {poor}"
        ).rstrip()


def terms_html(result: Result, content: AtRest) -> str:
    """Return fitted and set noise terms as an HTML table."""
    rows = []
    for number, (triad, terms) in enumerate(content.terms.items()):
        group = result.experiment.sensors.groups()[triad]
        for name, fitted in rest.in_setting_units(triad, terms).items():
            css = ' class="group"' if number and name == "noise_density" else ""
            pairs = zip(fitted["value"], fitted["sigma"], strict=True)
            cells = "".join(f"<td>{with_sigma(value, sigma)}</td>" for value, sigma in pairs)
            given = "".join(f"<td>{value}</td>" for value in _set(group, name))
            rows.append(
                f"<tr{css}><td>{TITLES[triad]}: {WORDS[name]}</td>"
                f'<td class="unit">{escape(fitted["unit"])}</td>{cells}{given}</tr>'
            )
        cells = "".join(
            f"<td>{chi_square:.1f} / {degrees:.0f}, p {p_value:.2g}</td>"
            for chi_square, degrees, p_value in zip(
                terms.chi_square, terms.degrees, terms.p_value, strict=True
            )
        )
        rows.append(
            f'<tr><td>{TITLES[triad]}: goodness of fit, χ² / degrees of freedom</td><td class="unit"></td>'
            f"{cells}<td></td><td></td><td></td></tr>"
        )
    head = "".join(f"<th>{word} {axis}</th>" for word in ("fitted", "set") for axis in "xyz")
    table = f'<table><tr><th></th><th class="unit">unit</th>{head}</tr>{"".join(rows)}</table>'
    return scroll_box(table, "Coefficients")


def _set(group: Settings, name: str) -> list[str]:
    """Return the values of a setting, one for each axis; empty for a term without a setting."""
    if name not in rest.TERMS.values():
        return [""] * 3
    return [f"{value:.4g}" for value in np.broadcast_to(getattr(group, name), 3)]


def with_sigma(value: float, sigma: float) -> str:
    """Return a value and its σ, both rounded to the first digit of σ; to the second if the first is a one."""
    if not np.isfinite(value):
        return "–"
    if not np.isfinite(sigma) or sigma <= 0:
        return f"{value:.3g}"
    first = int(np.floor(np.log10(sigma)))
    digits = max(0, -first + (sigma < 2 * 10.0**first))
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"
