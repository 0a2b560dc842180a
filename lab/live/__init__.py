"""Live: streams of real and simulated sensors, received, recorded and navigated with as they come.

>>> import lab.live
>>> with lab.live.open("simulated:montreal?device=vectornav") as source:
...     source.record("flight.inslab")
...     read = source.since()
...     print(source.status.sentence)
"""

from __future__ import annotations

from lab.live.source_opening import open_source as open

__all__ = ["open"]
