"""Raw flights in closed form, and what loggers do to them: rounding, jitter, coarse clocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lab.data.rebuild.raw_flight import RawFlight
from lab.missions import Recording
from lab.motion.frames import earth
from lab.motion.frames.rotation import C_nb_from_euler


def weave(
    time: np.ndarray, latitude: float = 45.0, longitude: float = -73.0, wind: tuple[float, float] = (0.0, 0.0)
) -> RawFlight:
    """Return a flight that weaves along a parallel, its velocity in closed form.

    Latitude, longitude and height are sines and lines in time; velocity is their derivative times the radii
    of curvature (Groves 2.111). It points along its path but for angles that vary, through air that moves.
    """
    phi = np.radians(latitude) + 4e-5 * np.sin(0.15 * time)
    phi_rate = 4e-5 * 0.15 * np.cos(0.15 * time)
    lam = np.radians(longitude) + 1.2e-5 * time + 2e-5 * np.sin(0.1 * time)
    lam_rate = 1.2e-5 + 2e-5 * 0.1 * np.cos(0.1 * time)
    height = 500 + 30 * np.sin(0.2 * time)
    meridian, transverse = earth.radii(np.sin(phi))
    velocity = np.stack(
        (
            phi_rate * (meridian + height),
            lam_rate * (transverse + height) * np.cos(phi),
            -30 * 0.2 * np.cos(0.2 * time),
        ),
        axis=-1,
    )
    course = np.arctan2(velocity[:, 1], velocity[:, 0])
    euler = np.stack((0.3 * np.sin(0.3 * time), 0.05 + 0.03 * np.cos(0.25 * time), course + 0.05), axis=-1)
    air = np.einsum("nji,nj->ni", C_nb_from_euler(euler), velocity - (*wind, 0.0))
    speed = np.linalg.norm(air, axis=1)
    return RawFlight(
        format="closed form",
        time=time,
        latitude=phi,
        longitude=lam,
        height=height,
        velocity_n=velocity,
        euler=euler,
        airspeed=speed,
        alpha=np.arctan2(air[:, 2], air[:, 0]),
        beta=np.arcsin(air[:, 1] / speed),
        rows_read=len(time),
    )


def raw_of(recording: Recording) -> RawFlight:
    """Return a recording as a reader would deliver it."""
    names = ("time", "latitude", "longitude", "height", "velocity_n", "euler", "airspeed", "alpha", "beta")
    return RawFlight(format="recording", **{name: getattr(recording, name) for name in names})


def rounded_positions(raw: RawFlight, decimals: int) -> RawFlight:
    """Return the flight with latitude and longitude to some decimals of a degree."""
    places = {
        name: np.radians(np.round(np.degrees(getattr(raw, name)), decimals))
        for name in ("latitude", "longitude")
    }
    return replace(raw, **places)


def without(raw: RawFlight, *names: str) -> RawFlight:
    """Return the flight without some quantities."""
    return replace(raw, **dict.fromkeys(names))


def position(flight: RawFlight | Recording) -> np.ndarray:
    """Return latitude, longitude [rad] and height [m], (n, 3)."""
    return np.stack((flight.latitude, flight.longitude, flight.height), axis=-1)
