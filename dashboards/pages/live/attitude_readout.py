"""Attitude readout: roll, pitch and heading in digits that are legible from two metres, each with its σ."""

from __future__ import annotations

import numpy as np

from dashboards.pages.base import NARROW
from dashboards.style import wide_html
from lab.data.streams.source_status import ENDED, OPENING, STREAMING
from lab.live.live_state import LiveState

ANGLES = ("Roll", "Pitch", "Heading")
"""What is read out."""
UNKNOWN = "—"
"""Stands for an angle that nothing shows."""
_COARSE = 10.0
"""σ from which an angle is shown without decimals [°]: they would mean nothing."""
_RELATIVE = np.pi
"""σ from which a heading is relative [rad], as of `lab.live.live_state.LiveState`."""
_STYLE = f"""
.angles {{ display: grid; grid-template-columns: repeat(3, minmax(0, 1fr)); gap: 0 12px;
          font-variant-numeric: tabular-nums; }}
.angle b {{ display: block; font-weight: 500; line-height: 1.02; font-size: clamp(44px, 7.2cqw, 120px);
           white-space: nowrap; letter-spacing: -0.02em; }}
.angle span {{ font-size: clamp(15px, 1.5cqw, 22px); }}
.angle .sigma {{ opacity: 0.75; margin-left: 0.6em; }}
.stands b {{ opacity: 0.45; }}
@container stage (max-width: {NARROW}px) {{
  .angles {{ grid-template-columns: minmax(0, 1fr); }}
  .angle {{ display: flex; align-items: baseline; }}
  .angle b {{ order: 1; flex: 1; text-align: right; font-size: 56px; }}
  .angle span {{ width: 4.2em; }}
  .angle .sigma {{ order: 2; width: 4.6em; }}
}}
"""


class AttitudeReadout:
    """Shows the attitude of the navigator.

    Attributes
    ----------
    view : panel.pane.HTML
        The digits; invisible without a source.
    """

    def __init__(self) -> None:
        self._source = OPENING
        self.view = wide_html(visible=False, margin=(8, 10, 2, 10), stylesheets=[_STYLE])

    def clear(self) -> None:
        """Show nothing: there is no source."""
        self.view.visible = False

    def show(self, state: LiveState, source: str = "") -> None:
        """Show the attitude now: pale if it is that of the last samples, none once the source has ended.

        Parameters
        ----------
        state
            What the navigator knows.
        source
            The state of the source; empty for that of the last call.
        """
        self._source = source or self._source
        known = np.isfinite(state.euler_sigma) & (self._source != ENDED)
        angles = np.where(known, state.euler, np.nan)
        if not state.euler_sigma[2] < _RELATIVE:
            angles[2] = np.nan
        angles = np.degrees(angles)
        angles[2] %= 360
        shown = zip(ANGLES, angles, np.degrees(state.euler_sigma), strict=True)
        stands = "" if self._source == STREAMING else " stands"
        self.view.object = f'<div class="angles{stands}">{"".join(_angle(*one) for one in shown)}</div>'
        self.view.visible = True


def _angle(name: str, angle: float, sigma: float) -> str:
    if not np.isfinite(angle):
        return (
            f'<div class="angle stands"><b>{UNKNOWN}</b><span>{name}</span><span class="sigma"></span></div>'
        )
    coarse = sigma >= _COARSE
    digits = f"{angle:.{0 if coarse else 1}f}"
    if name == ANGLES[2] and digits.startswith("360"):
        digits = digits.replace("360", "0")
    digits = digits.replace("-", "" if float(digits) == 0 else "\u2212")  # no minus before a zero
    spread = f"{sigma:.0f}" if coarse else f"{sigma:.2f}" if sigma < 1 else f"{sigma:.1f}"
    return (
        f'<div class="angle"><b>{digits}°</b><span>{name}</span><span class="sigma">σ {spread}°</span></div>'
    )
