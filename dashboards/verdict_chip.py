"""Verdict chip: the verdict on the shown result, always in the header, with its evidence and its cure."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
import panel as pn
import panel_material_ui as pmui
import param
from bokeh.document import Document

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.openings import Openings
from dashboards.seen_names import as_seen
from dashboards.sending import soon, together
from dashboards.session import Session
from dashboards.style import plain_column, wide_html
from dashboards.widgets import SETTING
from lab.analysis.verdicts.finding import Change, Finding, Verdict
from lab.analysis.verdicts.finding_table import LINEAR_MODEL
from lab.analysis.verdicts.trial import apply_changes, can_be_tried
from lab.base.numbers import format_number
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.run.memory import give_back, large_blocks_given_back

SETTLED = 150
"""Time after a new result until it is judged [ms], so that a moving slider is not slowed."""
CROWDED = 500
"""Time between two looks whether all pages that open have opened [ms]."""
CLOSED = 300
"""Time until a card that closes has gone [ms]."""
PLACE = (50, 16)
"""Place of the card: below the header, at its left end, where a phone has room too [px]."""
JUDGING = "Judging …"
UNKNOWN = "No verdict"

_CHIP: dict[str, Any] = {
    "whiteSpace": "nowrap",
    "overflow": "hidden",
    "textOverflow": "ellipsis",
    "display": "block",
    "maxWidth": "min(420px, 36vw)",
    "borderRadius": "14px",
    "padding": "2px 12px !important",
    "lineHeight": "1.6",
    "border": "1px solid transparent",
    "@media (max-width: 480px)": {"maxWidth": "calc(100vw - 226px)"},  # the buttons of its row
    "transition": "none",  # a fading colour is that of an older verdict
}
_GREY = {"backgroundColor": "transparent", "color": "#ffffff", "borderColor": "rgba(255, 255, 255, 0.45)"}
_DRESS: dict[bool | None, dict[str, str]] = {
    True: {"backgroundColor": "#0b7a5a", "color": "#ffffff"},
    False: {"backgroundColor": "#f0a050", "color": "#1b1200"},
    None: _GREY,
}
"""Colours of a consistent filter, one with findings, and no verdict; the text says it as well."""
LOOK = "--verdict-look"
"""Property of the drawn chip that says which of these colours it has."""
_STRUCK = {"opacity": "0.75", "textDecoration": "line-through"}
_OLD = """
:host([data-old]) button { background-color: transparent !important; color: #ffffff !important;
                           border-color: rgba(255, 255, 255, 0.45) !important; opacity: 0.75;
                           text-decoration: line-through; }
"""
"""The same while a setting is on its way to the server: see `STALE` in `browser_scripts`."""
_WORDS = """
:host { font: 14px/1.5 Roboto, sans-serif; color: var(--mui-palette-text-primary); }
h2 { font-size: 16px; font-weight: 500; margin: 0 0 4px; }
p { margin: 4px 0; }
.quiet { opacity: .72; font-size: 13px; }
"""
_CARD = {"& .MuiPaper-root": {"padding": "12px 16px", "width": "min(520px, 92vw)"}}


class VerdictChip:
    """A chip that names the verdict on the shown result, and a card with its evidence and its advice.

    As soon as a run begins, the old verdict is struck out. The result is judged once it has been shown for a
    moment; its advice is tried when the card is opened.

    Parameters
    ----------
    session
        The session whose results are judged, and whose settings the advice changes.
    document
        The document of the page.
    main
        The part of the page below the header, which gets the card when it is first opened; in the header, it
        would have the colours of the header.

    Attributes
    ----------
    view : viewable
        The chip, to place in the header.
    """

    def __init__(self, session: Session, document: Document, main: pn.Column) -> None:
        self._session, self._document, self._main = session, document, main
        self._openings = Openings.of(document)
        self._result: Result | None = None
        self._verdict: Verdict | None = None
        self._due = 0
        self._changes: tuple[Change, ...] = ()
        self._card: pmui.Popup | None = None
        self._work: LatestWins[tuple[Result, bool]] = LatestWins(
            self._judge, self._deliver, LONG, at_once=True
        )
        self._chip = pmui.Button(
            label=JUDGING,
            size="small",
            variant="contained",
            disable_elevation=True,
            margin=(10, 8),
            css_classes=["verdict-chip"],
            stylesheets=[_OLD],
        )
        self._dress(struck=False)
        self._chip.on_click(lambda _event: self._open())
        self.view = self._chip
        session.on_run(self.wait)
        session.param.watch(self._arrived, "result", onlychanged=False)
        session.param.watch(self._failed, "problem")

    def wait(self) -> None:
        """Strike the verdict out: a run has begun, so it is that of older settings."""
        self._due += 1
        self._work.cancel()
        self._result = None  # that of a long flight is released before the run begins
        with together(self._document):
            self._dress(struck=self._verdict is not None)
            if self._card is not None:
                self._card.open = False

    def close(self) -> None:
        """Judge no more."""
        self._due += 1
        self._work.close()
        self._result = self._verdict = None

    def _arrived(self, event: param.parameterized.Event) -> None:
        self._due += 1
        self._result = event.new
        if event.new is None:
            return
        due = self._due
        self._document.add_timeout_callback(lambda: self._begin(due), SETTLED)

    def _begin(self, due: int) -> None:
        """Judge the shown result, unless another one has come or is on its way.

        While pages open, it waits: a verdict takes as long as a run, and thirty pages have one each.
        """
        if due != self._due or self._result is None:
            return
        if self._openings is not None and self._openings.busy:
            self._document.add_timeout_callback(lambda: self._begin(due), CROWDED)
            return
        self._work.submit((self._result, False))

    def _failed(self, event: param.parameterized.Event) -> None:
        """Say that there is no verdict on a run that failed."""
        if event.new and self._result is None and not self._session.is_running:
            self._show(None)

    def _judge(self, wanted: tuple[Result, bool], _progress: Progress) -> Outcome:
        result, with_trials = wanted
        with large_blocks_given_back(result.time.size):
            found = attempt(lambda: result.tried_verdict if with_trials else result.verdict)
        if result.is_long:
            give_back()
        return found

    def _deliver(self, wanted: tuple[Result, bool], outcome: Outcome) -> None:
        soon(self._document, lambda: self._receive(wanted, outcome))

    def _receive(self, wanted: tuple[Result, bool], outcome: Outcome) -> None:
        result, with_trials = wanted
        if result is not self._result:
            return
        with together(self._document):
            if not with_trials:
                self._show(outcome.result)
            elif outcome.result is not None:
                self._fill(outcome.result, tried=True)
            else:
                self._words.object += f"<p>The advice could not be tried. {escape(outcome.problem)}</p>"

    def _show(self, verdict: Verdict | None) -> None:
        """Name a verdict on the chip; None if there is none."""
        self._verdict = verdict
        label = UNKNOWN if verdict is None else named(verdict)
        with together(self._document):
            if self._chip.label != label:
                self._chip.label = label
            self._dress(struck=False)

    def _dress(self, *, struck: bool) -> None:
        consistent = None if self._verdict is None else self._verdict.consistent
        sx = _CHIP | (_GREY | _STRUCK if struck else _DRESS[consistent])
        sx[LOOK] = "struck" if struck else str(consistent)
        sx |= {"&:hover": {"backgroundColor": sx["backgroundColor"], "filter": "brightness(1.12)"}}
        if self._chip.sx != sx:
            self._chip.sx = sx

    def _open(self) -> None:
        """Open the card, and try the advice on it."""
        result, verdict = self._result, self._verdict
        if result is None or verdict is None:
            return
        if self._card is None:
            self._card = self._made()
            self._main.append(self._card)
        trying = can_be_tried(verdict, result.algorithm)
        with together(self._document):
            self._fill(verdict, tried=not trying)
            self._card.open = True
        if trying:
            self._work.submit((result, True))

    def _made(self) -> pmui.Popup:
        self._words = wide_html(margin=0, stylesheets=[_WORDS])
        self._show_me = pmui.Button(label="Show me", size="small", variant="outlined", margin=(6, 8, 0, 0))
        self._show_me.on_click(lambda _event: self._shown())
        self._apply = pmui.Button(
            label="Apply", size="small", margin=(6, 8, 0, 0), visible=False, tags=[SETTING]
        )
        self._apply.on_click(lambda _event: self._applied())
        buttons = pn.Row(self._apply, self._show_me, margin=0)
        return pmui.Popup(
            plain_column(self._words, buttons),
            anchor_position=PLACE,
            transform_origin={"horizontal": "left", "vertical": "top"},
            elevation=8,
            sx=_CARD,
        )

    def _fill(self, verdict: Verdict, *, tried: bool) -> None:
        """Write the card of a verdict, whose advice is applied only once it has been tried."""
        assert self._card is not None
        self._words.object = card_html(verdict, tried=tried)
        self._changes = verdict.changes if tried else ()
        self._apply.visible = bool(self._changes)

    def _shown(self) -> None:
        """Open the page of the evidence, with the cursor where the innovations are largest."""
        result = self._result
        assert self._card is not None
        self._card.open = False
        if result is not None:
            self._session.go("Verdict", worst_time(result))

    def _applied(self) -> None:
        """Change the settings as the first advice says that was tried."""
        result, changes = self._result, self._changes
        assert self._card is not None
        self._card.open = False
        # The button that had the focus is gone with its card, which takes the focus back until then.
        self._document.add_timeout_callback(self._chip.focus, CLOSED)
        if result is None or not changes:
            return
        changed = apply_changes(result, changes)
        assert isinstance(changed, Experiment)
        try:
            self._session.accept(changed)
        except SettingError as error:
            self._session.problem = str(error)


def named(verdict: Verdict) -> str:
    """Return the text of a chip: the first finding in a few words, and the number of the others.

    >>> named(Verdict("Consistent: the errors match the filter's own σ.", (), "one run"))
    '● Consistent'
    """
    if verdict.consistent is None:
        return f"○ {UNKNOWN}"
    if verdict.consistent:
        return f"● Consistent, {as_seen(verdict.note.quantity)}" if verdict.note else "● Consistent"
    more = f" +{len(verdict.findings) - 1}" if len(verdict.findings) > 1 else ""
    return f"● {_short(verdict.findings[0])}{more}"


def _short(finding: Finding) -> str:
    if finding.quantity == LINEAR_MODEL:
        return "Beyond the linear model"
    quantity = as_seen(finding.quantity).replace("P0", "P₀")
    quantity = quantity[:1].upper() + quantity[1:]
    if finding.direction in ("too small", "too large") and np.isfinite(finding.factor):
        return f"{quantity} {format_number(finding.factor)} × {finding.direction}"
    return f"{quantity} {finding.direction}"


def card_html(verdict: Verdict, *, tried: bool) -> str:
    """Return what the card of a verdict says: each finding, its evidence and its advice, as HTML."""
    parts = [f"<h2>{escape(as_seen(verdict.headline))}</h2>"]
    for number, finding in enumerate(verdict.findings):
        sentence = f"{escape(as_seen(finding.sentence))} " if number else ""
        counsel = "Trying the advice …" if finding.changes and not tried else finding.counsel
        parts.append(
            f"<p>{sentence}{escape(as_seen(counsel))}</p>"
            f'<p class="quiet">Evidence: {escape(finding.evidence)}</p>'
        )
    parts += [f"<p>{escape(as_seen(one.sentence))} {escape(one.counsel)}</p>" for one in verdict.suggestions]
    parts += [f"<p>{escape(verdict.note.counsel)}</p>"] if verdict.note else []
    parts.append(f'<p class="quiet">Judged by {escape(verdict.basis)}.</p>')
    return "".join(parts)


def worst_time(result: Result) -> float | None:
    """Return the time of the fix with the largest NIS, in the clock of the run [s]; None without any."""
    nis = result.innovations["nis"]
    if not np.isfinite(nis.values).any():
        return None
    return float(result.fixes.time[int(np.nanargmax(nis.values))]) + result.epoch
