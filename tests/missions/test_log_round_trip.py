"""Logs and tracks: montreal, written as an autopilot or a receiver would, is the same flight.

Autopilots log velocity and attitude several times a second: what the curve through them costs is nearly all
of the rate at which they do.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from writers import WRITERS, ardupilot, ulog

from lab import ecef
from lab.missions import Recording, mission
from lab.missions.readers import read_raw
from lab.trajectory import Trajectory, Truth

TIMES = np.arange(3.0, 200.0, 0.05)


def rms(vectors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def errors(truth: Trajectory, curve: Trajectory, late: float) -> tuple[float, float, float, float]:
    """Return rms of position [m], velocity [m/s], attitude [°] and specific force [m/s²]."""
    a: Truth = truth.at(TIMES)
    b: Truth = curve.at(TIMES - late)
    turn = Rotation.from_quat(b.q_nb, scalar_first=True) * Rotation.from_quat(a.q_nb, scalar_first=True).inv()
    return (
        rms(ecef.way(a.position, b.position)),
        rms(b.velocity_n - a.velocity_n),
        float(np.degrees(rms(turn.as_rotvec()))),
        rms(curve.rates(TIMES - late)[1] - truth.rates(TIMES)[1]),
    )


@pytest.mark.parametrize(
    ("name", "boot", "rate", "bounds"),
    [
        # Single precision velocities 10 times a second, positions in double, quaternions 50 times.
        ("PX4 ULog", ulog.BOOT, 10.0, (1e-3, 4e-3, 2e-5, 0.1)),
        # Positions to 1e-7°, angles to 0.01°, all 25 times a second.
        ("ArduPilot DataFlash", ardupilot.BOOT, 25.0, (2e-3, 5e-4, 6e-3, 0.015)),
    ],
)
def test_the_flight_is_the_same_to_the_precision_of_the_log(name, boot, rate, bounds, tmp_path):
    recording = mission("montreal").recording
    path = tmp_path / "log.dat"
    path.write_bytes(WRITERS[name](recording))
    flight = read_raw(path)
    truth = Trajectory.from_recording(recording, 200.0)
    read = Recording(
        flight.time, flight.latitude, flight.longitude, flight.height, flight.velocity_n, flight.euler
    )
    found = errors(truth, Trajectory.from_recording(read, 100.0), flight.time[0] - boot * 1e-6)
    for error, bound in zip(found, bounds, strict=True):
        assert error <= bound
    # The format costs a tenth at most of what sampling the flight at its rate does.
    known = truth.at(np.arange(0.0, 204.9, 1 / rate))
    sampled = Recording(
        known.time, known.latitude, known.longitude, known.height, known.velocity_n, known.euler
    )
    assert found[3] <= 1.1 * errors(truth, Trajectory.from_recording(sampled, 100.0), 0.0)[3]
