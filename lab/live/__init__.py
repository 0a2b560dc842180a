"""Live: a stream is followed: navigated with as it comes, watched by many, compared with its simulation.

In: a source of `lab.data.streams`, real or simulated, or a phone. Out: what it shows now, and its history for
plots. `simulated` has the devices that are simulated, `phone` makes a phone a source, `bench` tests a sensor
on a desk.

Read first: `station` (one source, many watchers), `live_navigator` (the same step as a batch run),
`stations`.

>>> import lab.live
>>> with lab.live.open("simulated:montreal?device=vectornav") as source:
...     source.record("flight.inslab")
...     read = source.since()
...     print(source.status.sentence)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lab.base.registry import register
from lab.data.streams.source_opening import open_source as open

register("source", "simulated", "lab.live.simulated.simulated_transport:open_simulated")
register("source", "xplane", "lab.live.xplane.xplane_transport:open_xplane")

if TYPE_CHECKING:
    from lab.data.streams.source import Source
    from lab.live.beside.attitude_laboratory import AttitudeLaboratory
    from lab.navigation.settings import NavigatorSettings
    from lab.sensors.suite import SensorSuite


def attitudes(
    source: str | Source,
    *algorithms: Any,
    sensors: SensorSuite | None = None,
    navigator: NavigatorSettings | None = None,
) -> AttitudeLaboratory:
    """Follow a source with the navigator and with algorithms of your own beside it, and compare attitudes.

    Parameters
    ----------
    source
        Address of a source, or an open one; it ends with the laboratory.
    algorithms
        Classes or objects with a method `step`, as of `lab.live.beside.live_algorithm.LiveAlgorithm`, or
        places ``FILE.py:Name``. Each runs in a process of its own.
    sensors, navigator
        The assumptions of the navigator; those of an `Experiment` if they are left out.

    Raises
    ------
    LiveAlgorithmError, AlgorithmError
        If an algorithm cannot be loaded.
    """
    from lab.live.beside.attitude_laboratory import AttitudeLaboratory  # noqa: PLC0415 - imports the navigator
    from lab.navigation.settings import NavigatorSettings  # noqa: PLC0415 - as above
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - as above

    opened = open(source) if isinstance(source, str) else source
    return AttitudeLaboratory(opened, algorithms, sensors or SensorSuite(), navigator or NavigatorSettings())


__all__ = ["attitudes", "open"]
