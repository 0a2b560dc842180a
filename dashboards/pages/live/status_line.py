"""Status line: the state of a source and of its navigator in words and numbers, always visible."""

from __future__ import annotations

import re
from html import escape

import numpy as np
import panel as pn

from dashboards.seen_names import as_seen
from lab.data.streams.source_status import ENDED, LOST, OPENING, STALE, STREAMING, Status
from lab.live.live_state import WAITING, LiveState

NO_SOURCE = "Choose a source and connect it. The simulated device needs no hardware."

COLOURS = {
    STREAMING: "#12a67c",
    STALE: "#e8862e",
    LOST: "#e5484d",
    OPENING: "#808895",
    ENDED: "#808895",
}
"""Colour of the dot before each state; the word stands behind it."""
LARGEST_SIGMA = 1e-4
"""Largest σ with which a drift is shown: crystals drift by less."""
_STYLE = """
.state { font-weight: 600; text-transform: capitalize; }
.numbers { display: flex; flex-wrap: wrap; gap: 2px 18px; font-variant-numeric: tabular-nums; }
.numbers span { white-space: nowrap; }
.numbers b { font-weight: 600; }
.dim { opacity: 0.7; }
.numbers .wide { white-space: normal; overflow-wrap: anywhere; min-width: 0; }
.bad { color: color-mix(in srgb, #e5484d 65%, currentColor); }
@media (max-width: 600px) { :host { font-size: 13px; line-height: 1.35; } .numbers { gap: 1px 12px; } }
p { margin: 2px 0; overflow-wrap: anywhere; }
"""


class StatusLine:
    """Shows a status and a state.

    Attributes
    ----------
    view : panel.pane.HTML
        The line.
    """

    def __init__(self) -> None:
        self.view = pn.pane.HTML("", sizing_mode="stretch_width", margin=(2, 10), stylesheets=[_STYLE])
        self.say(NO_SOURCE)

    def say(self, sentence: str) -> None:
        """Show a sentence where there is no source."""
        self.view.object = f'<p><span class="dim">{escape(sentence)}</span></p>'

    def show(self, status: Status, state: LiveState, verdict: str, failure: str) -> None:
        """Show a source, its navigator with its remarks, and the verdict on its innovations."""
        dot = f'<span style="color:{COLOURS[status.state]}">●</span>'
        words = escape(f"{_without(status.state, status.sentence)} {status.warning}".strip())
        lines = [
            f'<p>{dot} <span class="state">{status.state}</span> <span class="dim">{words}</span></p>',
            f'<div class="numbers">{"".join(f"<span>{one}</span>" for one in _numbers(status, state))}</div>',
            _phase(status, state),
        ]
        if status.clock:
            lines.append(f'<p class="dim">{escape(status.clock)}</p>')
        if failure:
            lines.append(f'<p class="bad">{escape(failure)}</p>')
        if verdict:
            lines.append(f"<p><b>Verdict</b> {escape(as_seen(verdict))}</p>")
        lines += [f'<p class="dim">{escape(as_seen(remark))}</p>' for remark in state.remarks]
        self.view.object = "".join(lines)


def _without(state: str, sentence: str) -> str:
    """Return a sentence without the state at its beginning, which stands before it."""
    first, mark, more = re.match(r"([^.:]*)([.:]?)(.*)", sentence, re.DOTALL).groups()  # type: ignore[union-attr]
    if first.lower() != state or not mark:
        return sentence
    more = more.strip()
    return more[:1].upper() + more[1:]


def _phase(status: Status, state: LiveState) -> str:
    """Return what the navigator does; of a source that is lost, what it did with the last samples."""
    if status.state == LOST and state.phase != WAITING:
        words = f"{state.phase} with the last samples. {as_seen(state.reason)}"
        return f'<p class="dim">Before: {escape(words)}</p>'
    return f"<p><b>{escape(state.phase.capitalize())}</b> {escape(as_seen(state.reason))}</p>"


def _numbers(status: Status, state: LiveState) -> list[str]:
    """Return the numbers of a source with their names and units, as HTML."""
    seen, loss = status.statistics, status.loss
    corrupt = seen.failed + seen.refused
    found = [
        _named("Protocol", escape(status.protocol) or "—"),
        _named("Rate", f"{status.rate:.1f} Hz"),
        _named("Fixes", f"{status.fixes} ({status.fix_rate:.1f} Hz)"),
        _named("Jitter", _milliseconds(status.jitter)),
        _named("Latency", _milliseconds(status.latency)),
        _named("Missing", str(loss.missing), bad=loss.missing > 0),
        _named("Corrupt", str(corrupt), bad=corrupt > 0),
        _named("Clock drift", _drift(status)),
        _named("Samples", f"{status.samples:,}".replace(",", "\u2009")),
    ]
    if state.rows.spikes:
        found.append(_named("Spikes", str(state.rows.spikes), bad=True))
    if loss.jumps:
        found.append(_named("Clock changes", str(loss.jumps), bad=True))
    if status.timing:
        found.append(f'<span class="dim">Timed {escape(status.timing)}.</span>')
    if status.evidence and status.protocol:
        found.append(f'<span class="dim wide">{escape(status.evidence)}</span>')
    if status.recording:
        found.append(_named("Recorded", f"{status.recorded / 1e6:.2f} MB"))
    return found


def _drift(status: Status) -> str:
    """Return the drift of the device's clock with its σ, once it says something."""
    if not status.drift_sigma <= LARGEST_SIGMA:
        return "—"
    drift = f"{1e6 * status.drift:+.1f}".replace("-", "\u2212")
    return f"{drift} ± {1e6 * status.drift_sigma:.1f} ppm"


def _named(name: str, value: str, *, bad: bool = False) -> str:
    return f'<span class="dim">{name}</span> <b{" class=bad" if bad else ""}>{value}</b>'


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.2f} ms" if np.isfinite(seconds) else "—"
