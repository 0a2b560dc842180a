"""Flights where frames and angles are difficult: across equator and date line, and in loops."""

from __future__ import annotations

import numpy as np

from lab.motion.recordings.recording import Recording

STEP = 0.05
"""Time between the rows of the recordings [s]."""


def moved(latitude: float, longitude: float) -> Recording:
    """Return a flight with turns and climbs to the north-east, half of it on each side of a place [°]."""
    t = np.arange(0.0, 120.0 + STEP / 2, STEP)
    course = np.radians(45) + 0.6 * np.sin(2 * np.pi * t / 40)
    velocity = np.stack((70 * np.cos(course), 70 * np.sin(course), 3 * np.sin(0.1 * t)), axis=-1)
    way = np.concatenate((np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * STEP, axis=0)))
    way -= way[t.size // 2]
    north, east, down = way.T
    euler = np.stack((0.4 * np.sin(2 * np.pi * t / 40), 0.05 * np.sin(0.1 * t), course), axis=-1)
    place = np.radians(latitude) + north / 6.36e6
    around = np.radians(longitude) + east / (6.378e6 * np.cos(place))
    return Recording(t, place, (around + np.pi) % (2 * np.pi) - np.pi, 1000 - down, velocity, euler)


def looping() -> Recording:
    """Return a flight with three loops: the pitch passes ±90°."""
    t = np.arange(0.0, 150.0 + STEP / 2, STEP)
    angle = np.radians(10.0) * np.clip(t - 20.0, 0.0, 108.0)
    # The rate of the pitch begins and ends within a second.
    angle = np.convolve(np.pad(angle, 20, mode="edge"), np.full(41, 1 / 41), mode="valid")
    velocity = np.stack((50 * np.cos(angle), np.zeros_like(t), -50 * np.sin(angle)), axis=-1)
    way = np.concatenate((np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * STEP, axis=0)))
    over = np.where(np.cos(angle) < 0, np.pi, 0.0)
    latitude = 0.7 + way[:, 0] / 6.36e6
    euler = np.stack((over, np.arcsin(np.sin(angle)), over), axis=-1)
    return Recording(t, latitude, np.full_like(t, 0.2), 2000 - way[:, 2], velocity, euler)
