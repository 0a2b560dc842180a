"""Spectrum part: the spectra of gyros and accelerometers over the last seconds of a stream."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashboards.pages.base import make_hideable, plot_grid
from dashboards.pages.live.watched import ABOVE, LookingPart, Watched
from dashboards.session import Session
from dashboards.style import whole_column, wide_html
from lab.live.station import Station
from lab.live.stream_statistics import SEGMENT, Spectrum, compute_spectrum
from lab.sensors.suite import TRIADS
from lab.views.twin_comparison import SpectrumFigures, promised_density

LENGTH = 20.0
"""Time over which pieces are averaged [s]: their 19 halves overlap, and a line is seen after some seconds."""
LEAST = 2 * SEGMENT
"""Least time without a gap for a spectrum [s]: three pieces."""
_WORDS = (
    f"<p>Spectrum of the last {LENGTH:g} s (Welch), moving or at rest. A line is a vibration or a "
    "disturbance; the dashed curve is the noise of the settings.</p>"
)


class SpectrumPart(LookingPart):
    """The one-sided spectra beside the noise of the sensors in the settings.

    Parameters
    ----------
    session
        Its sensors are compared.

    Attributes
    ----------
    view : panel.Column
        All of it; invisible until there is a spectrum.
    """

    every = 2.0

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self._figures = SpectrumFigures("the settings")
        words = wide_html(_WORDS, margin=(4, 10))
        grid = plot_grid(self._figures.figures, 2, least=300, beside=ABOVE)
        self.view = make_hideable(whole_column(words, grid))

    def watch(self, watched: Watched | None) -> None:
        """Show another source, or none."""
        self._watched = watched
        self.view.visible = False
        self._figures.clear()

    def look(self, station: Station) -> Spectrum:
        """Return the spectra since the last gap, of at most the last `LENGTH`."""
        return recent_spectrum(station.source.last(LENGTH).imu)

    def show(self, found: Spectrum) -> None:
        """Draw them."""
        sensors = self._session.experiment.sensors
        self._figures.show(
            found, {triad: promised_density(sensors, triad, found.frequency) for triad in TRIADS}
        )
        self.view.visible = True


def recent_spectrum(imu: NDArray[np.void]) -> Spectrum:
    """Return the spectra of the samples since the last gap.

    Parameters
    ----------
    imu : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
        Samples.

    Raises
    ------
    ValueError
        If there are fewer than those of `LEAST`.
    """
    gaps = np.flatnonzero(imu["gap"])
    rows = imu[gaps[-1] if gaps.size else 0 :]
    if len(rows) < 2 or rows["time"][-1] - rows["time"][0] < LEAST:
        raise ValueError("The stream is too short for a spectrum")
    dt = float(rows["time"][-1] - rows["time"][0]) / (len(rows) - 1)
    return compute_spectrum({"gyro": rows["rate"], "accelerometer": rows["force"]}, dt, "mean")
