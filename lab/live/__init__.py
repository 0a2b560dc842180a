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

from lab.base.registry import register
from lab.data.streams.source_opening import open_source as open

register("source", "simulated", "lab.live.simulated.simulated_transport:open_simulated")
register("source", "xplane", "lab.live.xplane.xplane_transport:open_xplane")

__all__ = ["open"]
