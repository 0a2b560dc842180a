"""Simulators' formats: montreal, written as a simulator would, is the same flight, to its precision.

What is compared are the curves through the original and through what was read: position, velocity, attitude
and the specific force of the ideal IMU, which rounding spoils most.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from writers import WRITERS

from lab.data.formats import READERS, read_raw, reader_of
from lab.missions import mission, prepare_import
from lab.motion.frames import ecef
from lab.motion.truth.trajectory import Trajectory

RATE = 100.0
TIMES = np.arange(2.0, 203.0, 0.05)

BOUNDS = {
    "INS Lab flight csv": (1e-6, 1e-7, 1e-8, 1e-5),
    # Five decimals of a degree are 1 m, which the anchoring averages; the velocity has 1e-5 m/s.
    "X-Plane Data.txt": (0.06, 0.01, 1e-5, 5e-3),
    # No velocity: drawn through positions of 1 mm, smoothed.
    "MSFS/FSX fsLogger csv": (1e-3, 0.01, 1e-6, 0.15),
    # Doubles in full; the time is rounded to 8 µs.
    "MSFS Flight Recorder csv": (5e-6, 2e-5, 3e-5, 3e-4),
    "SimConnect csv": (5e-6, 2e-5, 3e-5, 3e-4),
    # Four fixes a second miss what the gusts do in between; the attitude is reconstructed.
    "FlightGear insgns-gps and insgns-imu": (0.01, 0.03, 0.05, 0.3),
    "JSBSim csv": (1e-7, 1e-8, 1e-9, 1e-6),
}
"""Rms of the error of position [m], velocity [m/s], attitude [°] and specific force [m/s²] accepted."""


def written(name: str, folder: Path) -> list[Path]:
    content = WRITERS[name](mission("montreal").recording)
    files = content if isinstance(content, dict) else {"recording.dat": content}
    paths = [folder / file for file in files]
    for path, data in zip(paths, files.values(), strict=True):
        path.write_bytes(data)
    return paths


@cache
def original() -> Trajectory:
    return Trajectory.from_recording(mission("montreal").recording, RATE)


def rms(vectors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


@pytest.mark.proof
@pytest.mark.parametrize("name", BOUNDS)
def test_the_flight_is_the_same_to_the_precision_of_the_format(name, tmp_path):
    made = prepare_import(written(name, tmp_path))
    assert made.raw.format == name
    assert made.raw.rows_read >= len(made.raw.time) > 800
    assert made.report.verdict == "plausible"
    imported = Trajectory.from_recording(made.recording, RATE)
    truth, read = original().at(TIMES), imported.at(TIMES)
    turn = (
        Rotation.from_quat(read.q_nb[:, [1, 2, 3, 0]]) * Rotation.from_quat(truth.q_nb[:, [1, 2, 3, 0]]).inv()
    )
    errors = (
        rms(ecef.position(read.position) - ecef.position(truth.position)),
        rms(read.velocity_n - truth.velocity_n),
        np.degrees(rms(turn.as_rotvec())),
        rms(imported.rates(TIMES)[1] - original().rates(TIMES)[1]),
    )
    for error, bound in zip(errors, BOUNDS[name], strict=True):
        assert error <= bound


@pytest.mark.parametrize("name", ["MSFS/FSX fsLogger csv", "FlightGear insgns-gps and insgns-imu"])
def test_what_a_format_has_is_the_same_at_its_own_times(name, tmp_path):
    flight = read_raw(written(name, tmp_path))
    times = flight.time - flight.time[0]
    assert times[-1] > 204.0
    truth = original().at(np.clip(times, 0, original().duration))
    assert flight.latitude is not None and flight.longitude is not None and flight.height is not None
    place = np.column_stack((flight.latitude, flight.longitude, flight.height))
    # 1e-8° and 1e-10 rad are 1 mm; time is rounded to 8 µs, in which the aircraft goes half a millimetre.
    assert rms(ecef.position(place) - ecef.position(truth.position)) < 2e-3
    if flight.velocity_n is not None:
        # The writer's curve has its knots at 50 Hz.
        assert rms(flight.velocity_n - truth.velocity_n) < 3e-5
    if flight.euler is not None:
        # FlightGear's is reconstructed from rates of six decimals.
        assert rms(np.angle(np.exp(1j * (flight.euler - truth.euler)))) < np.radians(2e-3)
    if flight.body_rate is not None:
        assert rms(flight.body_rate - original().rates(np.clip(times, 0, original().duration))[0]) < 1e-4


@pytest.mark.proof
@pytest.mark.parametrize("name", WRITERS)
def test_only_its_own_reader_recognises_a_file(name, tmp_path):
    for path in written(name, tmp_path):
        assert reader_of(path).name == name
        head = path.read_bytes()[: 2**16]
        found = [reader.name for reader in READERS[:-1] if reader.recognises(head)]
        assert (found or [READERS[-1].name]) == [name]
