"""Beside lines: what `ins-lab live navigate` prints of attitudes beside that of the navigator."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.cli.app import CommandError
from lab.live.beside.attitude_comparison import HEAD, OURS, TRUTH, AttitudeComparison
from lab.live.beside.live_algorithm import LiveAlgorithmError
from lab.live.station import Station

OLDEST = 2.0
"""Age from which the last attitude is not shown any more [s]: two lines later."""


class BesideLines:
    """Attitudes beside that of the navigator: of algorithms of the user, and of the device itself.

    Parameters
    ----------
    station
        The station.
    places
        Places of the algorithms, ``FILE.py:Name``.

    Raises
    ------
    CommandError
        If one cannot be loaded.
    """

    def __init__(self, station: Station, places: Sequence[str]) -> None:
        names = [place.rpartition(":")[2] for place in places]
        if len(set(names)) < len(names):
            raise CommandError(f"--algorithm: {', '.join(names)}: accepted are different names")
        self._algorithms = [station.beside(*one) for one in zip(names, places, strict=True)]
        try:
            for own in self._algorithms:
                own.wait_until_loaded()
        except LiveAlgorithmError as error:
            raise CommandError(f"--algorithm {error}") from error
        self._comparison = AttitudeComparison(station, self._algorithms)
        self._last: dict[str, tuple[float, FloatArray]] = {}
        self._now = 0.0

    def advance(self, *, finish: bool = False) -> None:
        """Take what came since the last line."""
        if finish:
            for own in self._algorithms:
                own.wait(OLDEST)  # what is far behind would keep the person waiting
        time, euler = self._comparison.advance(finish)
        for number, name in enumerate(self._comparison.names):
            known = np.flatnonzero(np.isfinite(euler[:, number, 0]))
            if known.size:
                self._last[name] = float(time[known[-1]]), euler[known[-1], number]
        self._now = float(time[-1]) if time.size else self._now

    def lines(self) -> Iterator[str]:
        """Yield a line for each attitude beside ours that is known now."""
        for name, euler in self._shown():
            roll, pitch, heading = np.degrees(euler)
            yield f"{'':8} {roll:9.2f}{pitch:9.2f}{heading % 360:9.2f}  {name}"

    def facts(self) -> dict[str, Any]:
        """Return the attitudes beside ours [rad], and how the algorithms fare; empty if there is nothing."""
        shown = dict(self._shown())
        told = {own.name: own.sentence for own in self._algorithms}
        return {name: part for name, part in (("euler_beside", shown), ("algorithms", told)) if part}

    def conclusion(self) -> list[str]:
        """Return the table of differences, and how the algorithms fared, in lines that end; often none."""
        found = [str(one) for one in self._comparison.differences()] if self._has_others() else []
        told = [own.sentence for own in self._algorithms if own.sentence]
        return [*([HEAD, *found] if found else []), *told, *([""] if found or told else [])]

    def _has_others(self) -> bool:
        return bool(self._algorithms) or any(name not in (OURS, TRUTH) for name in self._comparison.known)

    def _shown(self) -> Iterator[tuple[str, FloatArray]]:
        for name, (time, euler) in self._last.items():
            if name != OURS and self._has_others() and self._now - time < OLDEST:
                yield name, euler
