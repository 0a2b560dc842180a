"""Flights over a pole in closed form, as recordings."""

from __future__ import annotations

import numpy as np

from lab.motion.frames import earth, rotation
from lab.motion.recordings.recording import Recording

FLIGHTS: dict[str, dict[str, float]] = {
    "straight over the north pole": {"miss": 0.0},
    "past the north pole at 40 m": {"miss": 40.0},
    "in a curve over the north pole": {"miss": 3.0, "bend": 2000.0},
    "straight over the south pole": {"miss": 0.0, "south": True},
    "in a curve by the south pole": {"miss": -300.0, "bend": 1500.0, "south": True},
}


def over_the_pole(
    miss: float = 0.0,
    bend: float = 0.0,
    *,
    south: bool = False,
    duration: float = 240.0,
    speed: float = 100.0,
    step: float = 0.05,
) -> Recording:
    """Return a flight over a pole at half time, with banks, climbs and a crabbing nose.

    Its vertical u is given in Earth-fixed axes, from which all else follows in closed form: position
    r_e = (N + h) u − e² N u_z z, its derivative, and what north makes of both.

    Parameters
    ----------
    miss
        How far from the pole it passes [m].
    bend
        Size of the curves to the side [m].
    south
        Whether the pole is the southern one.
    duration, speed, step
        Length [s], speed [m/s], and time between samples [s].
    """
    t = np.arange(0, duration + step / 2, step)
    radius, slow = 6.4e6, 2 * np.pi / 180
    x, x_rate = speed * (t - duration / 2 - 0.013) / radius, np.full_like(t, speed / radius)
    since = t - duration / 2
    y = (miss + bend * (1 - np.cos(slow * since))) / radius
    y_rate = bend * slow * np.sin(slow * since) / radius
    z = (-1 if south else 1) * np.sqrt(1 - x * x - y * y)
    up = np.stack((x, y, z), axis=-1)
    up_rate = np.stack((x_rate, y_rate, -(x * x_rate + y * y_rate) / z), axis=-1)

    height, height_rate = 3000 + 200 * np.sin(0.05 * t), 10 * np.cos(0.05 * t)
    squared = earth.ECCENTRICITY_SQUARED
    w = 1 - squared * z * z
    N = earth.SEMI_MAJOR_AXIS / np.sqrt(w)
    N_rate = N * squared * z * up_rate[:, 2] / w
    v_e = (N_rate + height_rate)[:, None] * up + (N + height)[:, None] * up_rate
    v_e[:, 2] -= squared * (N_rate * z + N * up_rate[:, 2])

    latitude, longitude = np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)
    (s, c), (sl, cl) = ((np.sin(angle), np.cos(angle)) for angle in (latitude, longitude))
    v_x, v_y, v_z = v_e.T
    north = -s * cl * v_x - s * sl * v_y + c * v_z
    east = -sl * v_x + cl * v_y
    down = -c * cl * v_x - c * sl * v_y - s * v_z
    yaw = np.arctan2(east, north) + 0.1 * np.sin(0.3 * t)
    euler = np.stack((0.6 * np.sin(0.4 * t), 0.2 * np.sin(0.7 * t), rotation.wrap(yaw)), axis=-1)
    return Recording(t, latitude, longitude, height, np.stack((north, east, down), axis=-1), euler)
