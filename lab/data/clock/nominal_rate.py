"""Nominal rate: the rate that a device is set to, of a measured one."""

from __future__ import annotations

USUAL_RATES = (
    1, 2, 4, 5, 8, 10, 20, 25, 40, 50, 60, 100, 104, 119, 120, 125, 128, 150, 160, 200, 208, 238, 240, 250,
    256, 300, 400, 416, 476, 500, 512, 600, 800, 833, 952, 1000, 1024, 1125, 1600, 2000,
)  # fmt: skip
"""Rates that devices are set to [Hz]."""
NEAR = 0.03
"""Largest part by which a measured rate may differ from a usual one: over `COUNTED`, at 50 Hz, one sample."""


def nominal_rate(measured: float) -> float:
    """Return the usual rate next to a measured one [Hz], or the measured one if none is near."""
    best = min(USUAL_RATES, key=lambda rate: abs(rate / measured - 1)) if measured > 0 else 0
    return float(best) if best and abs(best / measured - 1) <= NEAR else measured
