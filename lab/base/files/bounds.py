"""Bounds: limits of a user's flights and logs, each stated once."""

from __future__ import annotations

MIN_SAMPLES = 4
"""Fewest samples of a flight: a not-a-knot cubic spline needs four."""
MAX_DURATION = 86_400.0
"""Longest flight or log [s]: a day. A longer one is usually one whose time is in milliseconds."""
TIME_STAMPS = (-1e10, 1e10)
"""Time stamps of the lab's own csv files [s]: Unix time fits until the year 2286, its milliseconds do not."""

LATITUDES = (-90.0, 90.0)
"""Geodetic latitudes [°]: from pole to pole."""
LONGITUDES = (-360.0, 360.0)
"""Longitudes [°]: files count from -180 to 180 or from 0 to 360, and may run on over one of these ends."""
HEIGHTS = (-1000.0, 100_000.0)
"""Heights [m]: from below all land (Dead Sea, -430 m), with room for a bad fix, to where space begins."""
MAX_SPEED = 1000.0
"""Largest velocity component or speed [m/s]: the fastest aeroplane, the SR-71, reached 980 m/s."""
