"""Attitude laboratory: a source with the navigator and one's own algorithms beside it, in a notebook."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Self

from lab.base.python_file import describe_error
from lab.data.streams.source import Source
from lab.live.beside.attitude_comparison import HEAD, AttitudeComparison, Difference
from lab.live.beside.live_algorithm import LiveAlgorithmError
from lab.live.beside.own_algorithm import OwnAlgorithm
from lab.live.station import Station
from lab.navigation.algorithm_source import AlgorithmSource
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

if TYPE_CHECKING:
    import xarray as xr

_LOOK = 0.1
"""Time between two looks at the stream [s]."""


class AttitudeLaboratory:
    """A source that is followed by the navigator and by algorithms; a context manager that ends them all.

    >>> import lab.live
    >>> with lab.live.attitudes("simulated:montreal?device=vectornav", MyFilter) as laboratory:
    ...     laboratory.run(60)
    ...     print(laboratory)
    ...     laboratory.dataset().attitude.sel(axis="roll").plot(x="time", hue="estimate")

    Parameters
    ----------
    source
        The source, which ends with the laboratory.
    algorithms
        Classes that are called without arguments, objects with a method `step`, or places ``FILE.py:Name``.
    sensors, navigator
        The assumptions of the navigator.

    Raises
    ------
    LiveAlgorithmError
        If an algorithm cannot be loaded.
    AlgorithmError
        If an algorithm of a notebook uses what cannot travel to another process.
    """

    def __init__(
        self, source: Source, algorithms: tuple[Any, ...], sensors: SensorSuite, navigator: NavigatorSettings
    ) -> None:
        given = [(_name_algorithm(one), _recipe_of_algorithm(one)) for one in algorithms]
        self.station = Station(source, sensors, navigator, source.address)
        try:
            self.algorithms: list[OwnAlgorithm] = [self.station.beside(*one) for one in given]
            for one in self.algorithms:
                one.wait_until_loaded()
        except BaseException:
            self.station.close()
            raise
        self._comparison = AttitudeComparison(self.station, self.algorithms)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the source and everything that follows it; what was compared stays. May be repeated."""
        self._comparison.advance()
        self.station.close()

    def run(self, seconds: float) -> None:
        """Follow the stream for a time [s], or until it ends."""
        until = time.monotonic() + seconds
        while time.monotonic() < until and not self.station.source.ended:
            time.sleep(_LOOK)
            self._comparison.advance()
        if self.station.source.ended:
            self.station.wait()
            for one in self.algorithms:
                one.wait()
            self._comparison.advance(finish=True)

    def differences(self, seconds: float = float("inf")) -> list[Difference]:
        """Return how the attitudes differ, over the last seconds; see `AttitudeComparison.differences`."""
        return self._comparison.differences(seconds)

    def dataset(self) -> xr.Dataset:
        """Return the attitudes as a dataset: roll, pitch and heading [°] of each over time [s]."""
        return self._comparison.dataset()

    def __str__(self) -> str:
        lines = [HEAD, *map(str, self.differences())]
        return "\n".join([*lines, *(one.sentence for one in self.algorithms if one.sentence)])


def _name_algorithm(algorithm: Any) -> str:
    if isinstance(algorithm, str):
        return algorithm.rpartition(":")[2] or algorithm
    return algorithm.__name__ if isinstance(algorithm, type) else type(algorithm).__name__


def _recipe_of_algorithm(algorithm: Any) -> object:
    """Return what makes the algorithm in another process."""
    if isinstance(algorithm, str):
        return algorithm
    if isinstance(algorithm, type):
        try:
            algorithm = algorithm()
        except (Exception, SystemExit) as error:
            raise LiveAlgorithmError(
                f"{algorithm.__name__}: called without arguments, it fails: {describe_error(error)}; "
                "accepted "
                "is an object, or a class without arguments"
            ) from error
    return AlgorithmSource.of(algorithm)
