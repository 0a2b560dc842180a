"""Status line: a strip with the state of a source, one hint at a time, and all its numbers folded."""

from __future__ import annotations

import re
from html import escape

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.pages.missions.entry_fields import fields_row
from dashboards.seen_names import as_seen
from dashboards.style import plain_column
from lab.base.parameters.counted import count_noun
from lab.data.streams.source_status import ENDED, LOST, OPENING, STALE, STREAMING, Status
from lab.live.live_state import ATTITUDE_ONLY, NAVIGATING, WAITING, LiveState

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
.strip, .numbers { display: flex; flex-wrap: wrap; gap: 2px 18px; font-variant-numeric: tabular-nums; }
.strip { gap: 0; }
.strip > span + span::before { content: "·"; margin: 0 0.5em; opacity: 0.6; }
.strip span, .numbers span { white-space: nowrap; }
.numbers b { font-weight: 600; }
.dim { opacity: 0.7; }
.numbers .wide { white-space: normal; overflow-wrap: anywhere; min-width: 0; }
.bad { color: color-mix(in srgb, #e5484d 65%, currentColor); }
@media (max-width: 600px) { :host { font-size: 13px; line-height: 1.35; } .numbers { gap: 1px 12px; } }
p { margin: 2px 0; overflow-wrap: anywhere; }
"""
_STRIP = """
:host { width: auto !important; flex: 0 1 auto; align-self: center; }
"""
"""The strip is as wide as its words, so that the button stands behind them."""

_STAYS = """
:host { position: sticky !important; top: 0; z-index: 5; padding: 2px 0;
        background: var(--mui-palette-background-paper, canvas); }
"""


class StatusLine:
    """Shows a status and a state.

    Attributes
    ----------
    view : panel.Column
        The strip with the hint, which stay in sight when the page is scrolled.
    strip, hint, details : panel.pane.HTML
        The numbers that count; the one sentence that counts now; and all others, shown on request below them.
    """

    def __init__(self) -> None:
        wide = {"sizing_mode": "stretch_width", "stylesheets": [_STYLE]}
        self.strip = pn.pane.HTML("", margin=(2, 4, 2, 10), stylesheets=[_STYLE, _STRIP])
        self.hint = pn.pane.HTML("", margin=(0, 10), **wide)
        self.details = pn.pane.HTML("", visible=False, margin=(0, 10, 4, 10), **wide)
        self._fold = pmui.Button(
            label="Details", icon="expand_more", variant="text", size="small", margin=(0, 4), visible=False
        )
        self._fold.on_click(lambda _event: self._turn())
        self._told: tuple[Status, LiveState, str] | None = None
        self.view = plain_column(fields_row(self.strip, self._fold), self.hint, stylesheets=[_STAYS])
        self.say(NO_SOURCE)

    def say(self, sentence: str) -> None:
        """Show a sentence where there is no source."""
        self._told = None
        self.strip.visible = self._fold.visible = self.details.visible = False
        self._fold.icon = "expand_more"
        self.hint.object = f'<p><span class="dim">{escape(sentence)}</span></p>'

    def show(self, status: Status, state: LiveState, verdict: str, failure: str, name: str = "") -> None:
        """Show a source, its navigator with its remarks, and the verdict on its innovations."""
        self._told = status, state, name
        strip = "".join(f"<span>{one}</span>" for one in _strip(status, state))
        self.strip.object = f'<div class="strip">{strip}</div>'
        self.strip.visible = self._fold.visible = True
        self.hint.object = f"<p>{_hint(status, state, verdict, failure)}</p>"
        if self.details.visible:
            self.details.object = _details(status, state, name)

    def _turn(self) -> None:
        """Show the details, or fold them."""
        opens = not self.details.visible and self._told is not None
        if opens and self._told is not None:
            self.details.object = _details(*self._told)
        self.details.visible = opens
        self._fold.icon = "expand_less" if opens else "expand_more"


def _strip(status: Status, state: LiveState) -> list[str]:
    """Return what is always seen of a source, as HTML: state, rates, latency, losses, and what is wrong."""
    found = [
        f'<span style="color:{COLOURS[status.state]}">●</span> <span class="state">{status.state}</span>'
    ]
    if status.state == STREAMING and status.samples + status.fixes:
        found.append(f"{status.rate:.0f} Hz" if status.samples else "no IMU")
        found.append(f"{status.fix_rate:.2g} fix/s" if status.fixes else "no fixes")
        if np.isfinite(status.latency):
            found.append(f'<span title="Latency">{1e3 * status.latency:.0f} ms</span>')
    lost, corrupt = status.loss.missing, status.statistics.failed + status.statistics.refused
    found += [] if lost or status.interruptions else ["0 lost"]
    wrong = {
        f"{lost} lost": lost,
        count_noun(status.interruptions, "interruption"): status.interruptions,
        f"{corrupt} corrupt": corrupt,
        count_noun(state.rows.spikes, "spike"): state.rows.spikes,
        count_noun(status.loss.jumps, "clock change"): status.loss.jumps,
    }
    found += [f'<b class="bad">{words}</b>' for words, number in wrong.items() if number]
    if status.recording:
        found.append(f"{status.recorded / 1e6:.2f} MB recorded")
    return found


def _hint(status: Status, state: LiveState, verdict: str, failure: str) -> str:
    """Return the one sentence that counts now, as HTML: what is wrong goes before what is missing.

    The verdict follows the stream: there is none before the navigator has a position, nor after the end.
    """
    said = _strip_state(status.state, status.sentence)
    if failure:
        return f'<span class="bad">{escape(failure)}</span>'
    if status.warning:
        return escape(f"{said} {status.warning}".strip())
    if status.state != STREAMING or (said and state.phase == WAITING):
        return escape(said)
    name, words = state.phase.capitalize(), _shorten_reason(state)
    if verdict and state.phase == NAVIGATING:
        name, words = "Verdict", verdict
    beside = f' <span class="dim">{escape(said)}</span>' if said else ""  # as of a simulator's pace
    return f"<b>{escape(name)}</b> {escape(as_seen(words))}{beside}"


def _shorten_reason(state: LiveState) -> str:
    """Return the sentence of a reason that says what is missing, without what it says in brackets and on.

    The whole reason is among the details.
    """
    if state.phase != ATTITUDE_ONLY:
        return state.reason
    sentences = state.reason.split(". ")  # the first says what the position is, if there are more
    return sentences[min(1, len(sentences) - 1)].partition(" (")[0].rstrip(".") + "."


def _details(status: Status, state: LiveState, name: str) -> str:
    """Return all that is known of a source and its navigator, as HTML."""
    numbers = "".join(f"<span>{one}</span>" for one in _numbers(status))
    lines = [f'<div class="numbers">{numbers}</div>']
    if status.state == LOST and state.phase != WAITING:
        words = f"Before: {state.phase} with the last samples. {state.reason}"
    elif status.state in (STREAMING, STALE):
        words = f"{state.phase.capitalize()}: {state.reason}"
    else:
        words = ""
    remarks = () if status.state == ENDED else state.remarks
    said = [name, status.clock, *(as_seen(one) for one in (words, *remarks))]
    return "".join([*lines, *(f'<p class="dim">{escape(one)}</p>' for one in said if one)])


def _strip_state(state: str, sentence: str) -> str:
    """Return a sentence without the state at its beginning, which stands before it."""
    first, mark, more = re.match(r"([^.:]*)([.:]?)(.*)", sentence, re.DOTALL).groups()  # type: ignore[union-attr]
    if first.lower() != state or not mark:
        return sentence
    more = more.strip()
    return more[:1].upper() + more[1:]


def _numbers(status: Status) -> list[str]:
    """Return the numbers of a source with their names and units, as HTML."""
    found = [
        _name_value("Protocol", escape(status.protocol) or "—"),
        _name_value("Rate", f"{status.rate:.1f} Hz"),
        _name_value("Fixes", f"{status.fixes} ({status.fix_rate:.1f} Hz)"),
        _name_value("Jitter", _milliseconds(status.jitter)),
        _name_value("Latency", _milliseconds(status.latency)),
        _name_value("Clock drift", _drift(status)),
        _name_value("Samples", f"{status.samples:,}".replace(",", "\u2009")),
    ]
    if status.timing:
        found.append(f'<span class="dim">Timed {escape(status.timing)}.</span>')
    if status.evidence and status.protocol:
        found.append(f'<span class="dim wide">{escape(status.evidence)}</span>')
    return found


def _drift(status: Status) -> str:
    """Return the drift of the device's clock with its σ, once it says something."""
    if not status.drift_sigma <= LARGEST_SIGMA:
        return "—"
    drift = f"{1e6 * status.drift:+.1f}".replace("-", "\u2212")
    return f"{drift} ± {1e6 * status.drift_sigma:.1f} ppm"


def _name_value(name: str, value: str) -> str:
    return f'<span class="dim">{name}</span> <b>{value}</b>'


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.2f} ms" if np.isfinite(seconds) else "—"
