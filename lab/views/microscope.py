"""Microscope: one update of the filter as text, tables of numbers, and the ellipses of its innovation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.models.ranges import DataRange1d
from bokeh.models.sources import ColumnDataSource
from bokeh.plotting import figure
from scipy import special

from lab.base.arrays import FloatArray
from lab.base.numbers import format_number
from lab.views.ensemble_cards import scroll_box
from lab.views.figures import plain_figure
from lab.views.legend import add_legend
from lab.views.quantities import BLUE, FIXES, TRUTH

if TYPE_CHECKING:
    import xarray as xr

NOT_OBSERVED = 0.9
"""σ now over σ at the start from which a direction counts as not observed: nine tenths are left."""
SHARE = 0.1
"""Smallest square of a state's part in a direction for which the state is named."""
MOST = 6
"""Largest number of directions in words."""
PALE = 0.05
"""Correlation below which a cell stays empty: knowing one state takes a thousandth off σ of the other."""
ROUNDING = 1e-6
"""Difference of two covariances, in σ of their states, up to which it is rounding."""
_CHI_SQUARE = float(np.sqrt(2 * special.gammaincinv(1, 0.95)))
"""Half-axis, in σ, of the ellipse that contains 95 % of two normal numbers."""
_LETTERS = {"position": "p", "velocity": "v", "attitude": "φ", "gyro": "g", "accelerometer": "a"}
_SMALLER = "font-size:10px;opacity:.8"


class EllipseFigures:
    """The horizontal innovation of a fix, in position and in velocity, with the ellipses of 95 %.

    Attributes
    ----------
    figures : list of figure
        Position, and velocity.
    """

    def __init__(self) -> None:
        self._sources = [
            {name: ColumnDataSource({"east": [], "north": []}) for name in ("innovation", "S", "HPHᵀ")}
            for _ in range(2)
        ]
        self.figures = [
            self._draw(f"{kind.capitalize()} innovation [{unit}]", sources)
            for kind, unit, sources in zip(("position", "velocity"), ("m", "m/s"), self._sources, strict=True)
        ]

    @staticmethod
    def _draw(title: str, sources: dict[str, ColumnDataSource]) -> figure:
        fig = plain_figure(
            title,
            "east",
            "north",
            height=300,
            match_aspect=True,
            x_range=DataRange1d(range_padding=0.4),
            y_range=DataRange1d(range_padding=0.4),
            tools=[],
        )
        at: Any = {"x": "east", "y": "north"}
        predicted = fig.line(**at, source=sources["HPHᵀ"], color=TRUTH, line_width=1.6, line_dash="dashed")
        whole = fig.line(**at, source=sources["S"], color=BLUE, line_width=2)
        fig.scatter([0], [0], marker="cross", size=12, color=TRUTH)
        point = fig.scatter(**at, source=sources["innovation"], color=FIXES, size=9, name="innovation")
        add_legend(fig, {"innovation": point, "95 % by S": whole, "by P alone": predicted})
        return fig

    def show(self, update: xr.Dataset) -> None:
        """Draw an update."""
        measured = update.measurement.values.tolist()
        H, P = update.H.values, update.before.values
        for kind, sources, fig in zip(("position", "velocity"), self._sources, self.figures, strict=True):
            wanted = [f"{kind} east", f"{kind} north"]
            fig.visible = set(wanted) <= set(measured)
            if not fig.visible:
                continue
            rows = [measured.index(name) for name in wanted]
            y, S = update.innovation.values[rows], update.S.values[np.ix_(rows, rows)]
            sources["innovation"].data = {"east": y[:1], "north": y[1:]}
            sources["S"].data = _ellipse(S)
            sources["HPHᵀ"].data = _ellipse(H[rows] @ P @ H[rows].T)


def _ellipse(C: FloatArray) -> dict[str, FloatArray]:
    """Return the points of the ellipse that contains 95 % of two numbers with a covariance."""
    values, vectors = np.linalg.eigh(C)
    turn = np.linspace(0, 2 * np.pi, 73)
    points = vectors @ (_CHI_SQUARE * np.sqrt(np.maximum(values, 0))[:, None] * [np.cos(turn), np.sin(turn)])
    return {"east": points[0], "north": points[1]}


def number(value: float, digits: int = 3) -> str:
    """Return a number as text, with a true minus sign."""
    return f"{value:z.{digits}g}".replace("-", "−")


def name_state(state: str) -> str:
    """Return the name of a state with what people call it."""
    return f"{state} (heading)" if state == "attitude down" else state


def symbols(names: Sequence[str]) -> list[str]:
    """Return a short sign for each state, for the head of a column."""
    found = []
    for place, name in enumerate(names):
        kind, *more = name.split()
        plain = kind in _LETTERS and (len(more) == 1 or more[0] in {"bias", "scale"}) and len(more) < 3
        axis = more[-1][0] if more else ""
        letter = _LETTERS.get(kind, "") + ("s" if "scale" in more else "")
        found.append(f"{letter}<sub>{escape(axis)}</sub>" if plain else str(place + 1))
    return found


def drop_known_states(update: xr.Dataset) -> xr.Dataset:
    """Return an update without the states that are known exactly."""
    P = np.diagonal(update.before.values) + np.diagonal(update.after.values)
    return update.isel(state=P > 0, other_state=P > 0)


def sentence(update: xr.Dataset, count: int) -> str:
    """Return what the filter did with the fix, in words."""
    about, low, high = update.attrs, update.attrs["nis_from"], update.attrs["nis_to"]
    head = f"Fix {about['fix'] + 1} of {count}, at {about['time']:.6g} s"
    within = "inside" if low <= about["nis"] <= high else "outside"
    nis = f"NIS {about['nis']:.3g} is {within} the 95 % interval, {low:.3g} to {high:.3g}"
    if about["outcome"] == "rejected":
        return f"{head}: rejected by the gate, so nothing was updated. {nis}."
    if about["outcome"] == "recovered":
        return f"{head}: so implausible that the filter raised P, and then used the fix. {nis}."
    held = (
        " This fix says nothing about heading and vertical gyro bias, so both kept their estimates."
        if about["heading_held"]
        else ""
    )
    return f"{head}: used. {nis}.{held}"


def equations(update: xr.Dataset) -> list[tuple[str, str]]:
    """Return the equations of the update, each with its numbers in words."""
    H, P, R, S = (update[name].values for name in ("H", "before", "R", "S"))
    y, K, x = (update[name].values for name in ("innovation", "gain", "correction"))
    units, measured = update.measured_unit.values, update.measurement.values
    found = [("y = z − H x⁻", _vector(y, measured, units) + "; navigator minus fix")]
    predicted = np.diagonal(H @ P @ H.T)
    first = f"{measured[0]}: {number(np.sqrt(S[0, 0]))}² = {number(np.sqrt(predicted[0]))}² + "
    own = S[0, 0] - predicted[0]
    found.append(("S = H P⁻ Hᵀ + R", f"{first}{number(np.sqrt(max(own, 0)))}² {units[0]}²"))
    found.append(("yᵀ S⁻¹ y", f"NIS = {number(update.attrs['nis'])}, {y.size} degrees of freedom"))
    if update.attrs["outcome"] == "rejected":
        return [*found, ("x⁺ = 0, P⁺ = P⁻", "the fix was rejected: nothing was updated")]
    weight = own / R[0, 0]
    if update.attrs["outcome"] == "used" and weight < 1 - ROUNDING:
        found.append((f"R / {number(weight)}", "the robust update gives this fix less weight"))
    names, shown = update.state.values, update.unit.values
    sigma = np.sqrt(np.diagonal(P))
    per = np.divide(np.abs(x), sigma, out=np.zeros_like(x), where=sigma > 0)
    k = int(np.argmax(per))
    terms = " + ".join(
        f"({number(gain)})·({number(part)})" for gain, part in zip(K[k], y, strict=True) if gain * part
    )
    found.append(("x⁺ = K y", f"{name_state(names[k])}: {terms or '0'} = {number(x[k])} {shown[k]}"))
    after = np.sqrt(np.diagonal(update.after.values))
    k = int(np.argmin(np.divide(after, sigma, out=np.ones_like(sigma), where=sigma > 0)))
    change = f"σ of {name_state(names[k])}: {number(sigma[k])} → {number(after[k])} {shown[k]}"
    if update.attrs["outcome"] == "recovered":
        return [*found, ("P⁺", f"{change}; P was raised before the fix")]
    return [*found, ("P⁺ = (I − K H) P⁻", f"{change}{_difference(update, sigma)}")]


def _difference(update: xr.Dataset, sigma: FloatArray) -> str:
    """Return how far the filter's own P after the fix is from the formula."""
    H, P, R, K = (update[name].values for name in ("H", "before", "R", "gain"))
    kept = np.eye(sigma.size) - K @ H
    off = update.after.values - kept @ P @ kept.T - K @ R @ K.T
    largest = float(np.abs(off / np.outer(sigma, sigma)).max())
    if largest < ROUNDING:
        return "; this is the filter's P⁺ to rounding"
    part = format_number(100 * largest)
    return f"; the filter's own P⁺ differs by up to {part} % of σ² (see the document on filters)"


def _vector(y: FloatArray, measured: Sequence[str], units: Sequence[str]) -> str:
    parts = []
    for kind in dict.fromkeys(name.split()[0] for name in measured):
        rows = [at for at, name in enumerate(measured) if name.split()[0] == kind]
        axes = ", ".join(measured[at].split()[1] for at in rows)
        parts.append(f"{kind} ({', '.join(number(y[at]) for at in rows)}) {units[rows[0]]} {axes}")
    return "; ".join(parts)


def describe_unobserved(update: xr.Dataset) -> list[str]:
    """Return in sentences which directions of the error the flight so far has not shown."""
    ratio, along = update.ratio.values, update.along.values
    names, units = update.state.values, update.unit.values
    now, start = np.sqrt(np.diagonal(update.after.values)), update.start.values
    found = []
    for part, row in zip(ratio, along, strict=True):
        if part < NOT_OBSERVED:
            break
        order = np.argsort(-np.abs(row))
        parts = [at for at in order if row[at] ** 2 >= SHARE]
        if len(parts) == 1:
            at = parts[0]
            joint = " now," if part * NOT_OBSERVED > 1 else " of"
            text = f"σ {number(now[at])} {units[at]}{joint} {number(start[at])} {units[at]} at the start"
        else:
            text = f"σ in this direction is {100 * part:.0f} % of that at the start"
        first, *others = (name_state(names[at]) for at in parts)
        found.append(f"{first}{' with ' if others else ''}{', '.join(others)}: {text}")
    more = len(found) - MOST
    return found[:MOST] + ([f"and {more} more"] if more > 0 else [])


def update_html(update: xr.Dataset) -> str:
    """Return equations, observability, gains and covariances of an update as HTML."""
    update = drop_known_states(update)
    lines = "".join(f"<dt>{escape(left)}</dt><dd>{escape(right)}</dd>" for left, right in equations(update))
    items = "".join(f"<li>{escape(one)}</li>" for one in describe_unobserved(update))
    words = (
        f"<p>Not observed yet, because at least 90 % of σ at the start is left:</p><ul>{items}</ul>"
        if items
        else "<p>All directions are observed: less than 90 % of σ at the start is left.</p>"
    )
    return (
        f"<section><h3>The update</h3><dl>{lines}</dl></section>"
        f"<section><h3>Observability</h3>{words}</section>"
        f'<section class="wide"><h3>States and gain K</h3>{_gains(update)}</section>'
        f'<section class="wide"><h3>H</h3>{_measurement_matrix(update)}</section>'
        + "".join(
            f"<section><h3>P {word} the fix: correlations, σ on the diagonal</h3>"
            f"{_correlations(update, word)}</section>"
            for word in ("before", "after")
        )
    )


def _table(rows: Iterator[str], label: str, name: str = "") -> str:
    """Return a table that scrolls within its box, also by keys."""
    return scroll_box(f'<table class="{name}">{"".join(rows)}</table>', label)


def _gains(update: xr.Dataset) -> str:
    """Return σ, correction, and what a unit of each innovation does to each state, as HTML."""
    before, after = (np.sqrt(np.diagonal(update[name].values)) for name in ("before", "after"))
    columns = zip(update.measurement.values, update.measured_unit.values, strict=True)

    def rows() -> Iterator[str]:
        heads = ("σ at start", "σ before", "σ after", "x⁺ = K y")
        yield (
            f"<tr><th>State</th>{''.join(f'<th>{head}</th>' for head in heads)}"
            + "".join(
                f'<th>K, {name}<br><span style="{_SMALLER}">per {unit}</span></th>' for name, unit in columns
            )
            + "</tr>"
        )
        for at, name in enumerate(update.state.values):
            unit = escape(str(update.unit.values[at]))
            values = (update.start.values[at], before[at], after[at], update.correction.values[at])
            cells = "".join(f"<td>{number(value)}</td>" for value in (*values, *update.gain.values[at]))
            yield f"<tr><th>{escape(name_state(name))} [{unit}]</th>{cells}</tr>"

    return _table(rows(), "States and gain")


def _measurement_matrix(update: xr.Dataset) -> str:
    """Return H without the columns of states that the fix does not measure directly, as HTML."""
    H = update.H.values
    used = np.flatnonzero(H.any(axis=0))

    def rows() -> Iterator[str]:
        heads = (f"{escape(str(update.state.values[at]))}" for at in used)
        yield f"<tr><th>per unit of</th>{''.join(f'<th>{head}</th>' for head in heads)}</tr>"
        for name, unit, row in zip(update.measurement.values, update.measured_unit.values, H, strict=True):
            cells = "".join(f"<td>{number(row[at]) if row[at] else ''}</td>" for at in used)
            yield f"<tr><th>{name} [{unit}]</th>{cells}</tr>"

    return _table(rows(), "Measurement matrix H")


def _correlations(update: xr.Dataset, word: str) -> str:
    """Return P before or after the fix as a table of correlations with colours, with σ on its diagonal."""
    P, names = update[word].values, update.state.values
    sigma = np.sqrt(np.diagonal(P))
    scale = np.outer(sigma, sigma)
    r = np.divide(P, scale, out=np.zeros_like(P), where=scale > 0)
    signs = symbols(names)

    def rows() -> Iterator[str]:
        yield f"<tr><th></th>{''.join(f'<th>{sign}</th>' for sign in signs)}</tr>"
        for i, name in enumerate(names):
            unit = escape(str(update.unit.values[i]))
            cells = "".join(
                f'<td class="sigma">{number(sigma[i], 2)}<span>{unit}</span></td>'
                if i == j
                else _cell(float(r[i, j]))
                for j in range(len(names))
            )
            yield f"<tr><th>{escape(name_state(name))} <i>{signs[i]}</i></th>{cells}</tr>"

    return _table(rows(), f"Correlations {word} the fix", "correlations")


def _cell(r: float) -> str:
    """Return a correlation as a cell: blue if positive, orange if negative."""
    if not abs(r) >= PALE:
        return "<td></td>"
    colour = "59,142,234" if r > 0 else "232,134,46"
    text = f"{abs(r):.2f}".removeprefix("0")
    return f'<td style="background:rgba({colour},{0.6 * abs(r):.2f})">{"−" if r < 0 else ""}{text}</td>'
