"""Solutions and states of a live navigator, made by hand, as outlets send them."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from lab.data.protocols.sent_solution import SentSolution
from lab.live.live_state import NAVIGATING, LiveState

POSITION = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, -0.25], [0.5, -0.25, 16.0]])
"""Covariance of the position north, east, down [m²]."""


def solution(**changed: Any) -> SentSolution:
    """Return a solution near Montreal, 100 m above the ellipsoid, where the geoid is 30 m below it."""
    known: dict[str, Any] = {
        "time": 1234.5,
        "utc": 1_767_312_016.0624,  # 2 January 2026, 00:00:16.0624
        "unix": 1_767_312_016.25,
        "phase": NAVIGATING,
        "coasts": False,
        "latitude": 45.5,
        "longitude": -73.75,
        "height": 100.0,
        "is_above_sea": False,
        "geoid": -30.0,
        "position_covariance": POSITION,
        "velocity_n": np.array([3.0, -4.0, 0.5]),
        "velocity_sigma": np.array([0.1, 0.2, 0.3]),
        "euler": np.array([1.0, -2.0, 300.0]),
        "euler_sigma": np.array([0.1, 0.1, 0.5]),
        "has_heading": True,
        "attitude_covariance": np.diag([1e-6, 2e-6, 3e-6]),
        "rate": np.array([0.1, 0.2, -0.3]),
        "fixes_used": 7,
    }
    return SentSolution(**(known | changed))


def state(number: int = 0, **changed: Any) -> LiveState:
    """Return the state of a navigator at a time that grows with `number` by 20 ms."""
    known: dict[str, Any] = {
        "phase": NAVIGATING,
        "reason": "",
        "time": time.monotonic() + 0.02 * number,
        "position": np.radians([45.5, -73.75, np.degrees(100.0)]),
        "position_sigma": np.sqrt(np.diagonal(POSITION)),
        "position_covariance": POSITION,
        "velocity_n": np.array([3.0, -4.0, 0.5]),
        "velocity_sigma": np.array([0.1, 0.2, 0.3]),
        "euler": np.radians([1.0, -2.0, -60.0]),
        "euler_sigma": np.radians([0.1, 0.1, 0.5]),
        "heading_source": "from the course",
        "attitude_covariance": np.diag([1e-6, 2e-6, 3e-6]),
        "rate": np.radians([0.1, 0.2, -0.3]),
        "is_above_sea": False,
        "fixes_used": number,
    }
    return LiveState(**(known | changed))
