"""Logs and tracks: montreal, written as an autopilot or a receiver would, is the same flight.

Autopilots log velocity and attitude several times a second: what the curve through them costs is nearly all
of the rate at which they do.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from writers import WRITERS, ardupilot, mavlink, ulog

from lab.data.formats import read_raw
from lab.missions import Recording, mission
from lab.missions.flight_import import prepare_import
from lab.motion.frames import ecef
from lab.motion.frames.rotation import wrap
from lab.motion.truth.trajectory import Trajectory, Truth

TIMES = np.arange(3.0, 200.0, 0.05)


def rms(vectors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def errors(truth: Trajectory, curve: Trajectory, late: float) -> tuple[float, float, float, float]:
    """Return rms of position [m], velocity [m/s], attitude [°] and specific force [m/s²]."""
    a: Truth = truth.at(TIMES)
    b: Truth = curve.at(TIMES - late)
    turn = Rotation.from_quat(b.q_nb, scalar_first=True) * Rotation.from_quat(a.q_nb, scalar_first=True).inv()
    return (
        rms(ecef.displacement(a.position, b.position)),
        rms(b.velocity_n - a.velocity_n),
        float(np.degrees(rms(turn.as_rotvec()))),
        rms(curve.rates(TIMES - late)[1] - truth.rates(TIMES)[1]),
    )


@pytest.mark.proof
@pytest.mark.parametrize(
    ("name", "boot", "rate", "bounds"),
    [
        # Single precision velocities 10 times a second, positions in double, quaternions 50 times.
        ("PX4 ULog", ulog.BOOT, 10.0, (1e-3, 4e-3, 2e-5, 0.1)),
        # Positions to 1e-7°, angles to 0.01°, all 25 times a second.
        ("ArduPilot DataFlash", ardupilot.BOOT, 25.0, (2e-3, 5e-4, 6e-3, 0.015)),
        # Positions to 1e-7° ten times, velocities and angles in single precision 20 times a second.
        ("MAVLink tlog", 1000 * mavlink.BOOT, 20.0, (2e-3, 1e-3, 2e-5, 0.03)),
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
    print(
        f"\n{name}: position {found[0]:.2g} m, velocity {found[1]:.2g} m/s, attitude {found[2]:.2g}°, "
        f"specific force {found[3]:.2g} m/s²"
    )
    for error, bound in zip(found, bounds, strict=True):
        assert error <= bound
    # The format costs a tenth at most of what sampling the flight at its rate does.
    known = truth.at(np.arange(0.0, 204.9, 1 / rate))
    sampled = Recording(
        known.time, known.latitude, known.longitude, known.height, known.velocity_n, known.euler
    )
    assert found[3] <= 1.1 * errors(truth, Trajectory.from_recording(sampled, 100.0), 0.0)[3]


def along(curve: Trajectory, times: np.ndarray) -> np.ndarray:
    """Return the specific force in n (n, 3) [m/s²]: of a track the attitude is no measurement."""
    attitude = Rotation.from_quat(curve.at(times).q_nb, scalar_first=True)
    return attitude.apply(curve.rates(times)[1])


@pytest.mark.proof
@pytest.mark.parametrize(
    ("name", "curve", "bounds"),
    [
        # One point a second of 7 decimals and 0.1 m.
        ("GPX", "position", (0.06, 0.1, 0.35)),
        # 2 cm and 0.1 m; speed and course to 0.001 kt and 0.01°, five times a second.
        ("NMEA 0183", "velocity", (0.06, 0.1, 0.35)),
        # Four points a second of 1 mm and 1 cm of height.
        ("KML", "position", (0.01, 0.05, 0.3)),
        # One point a second of 9 decimals and 0.1 m.
        ("TCX", "position", (0.06, 0.1, 0.35)),
        # One record a second of 1 cm and 0.2 m of height.
        ("FIT", "position", (0.1, 0.1, 0.35)),
        # One fix a second of 2 cm and 1 m of height.
        ("IGC", "position", (0.35, 0.2, 0.5)),
    ],
)
def test_the_flight_of_a_track_is_the_same_and_its_attitude_reconstructed(name, curve, bounds, tmp_path):
    recording = mission("montreal").recording
    path = tmp_path / "track.dat"
    path.write_bytes(WRITERS[name](recording))
    made = prepare_import(path)
    assert made.rebuilt.curve == curve
    assert made.report.verdict == "plausible"
    truth = Trajectory.from_recording(recording, 200.0)
    read = Trajectory.from_recording(made.recording, 100.0)
    times = np.clip(TIMES, 0, read.duration)
    a, b = truth.at(times), read.at(times)
    found = (
        rms(ecef.displacement(a.position, b.position)),
        rms(b.velocity_n - a.velocity_n),
        rms(along(read, times) - along(truth, times)),
    )
    place, speed, force = found
    print(f"\n{name}: position {place:.2g} m, velocity {speed:.2g} m/s, specific force {force:.2g} m/s²")
    for error, bound in zip(found, bounds, strict=True):
        assert error <= bound
    # The bank is that of the turns; the angle of attack and the wind stay in pitch and yaw.
    off = np.degrees(np.sqrt(np.mean(wrap(b.euler - a.euler) ** 2, axis=0)))
    assert (off < (1.0, 4.0, 4.0)).all()
