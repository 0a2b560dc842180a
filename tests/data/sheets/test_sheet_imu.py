"""What gravity is in numbers without a unit, in flights that turn and climb."""

import numpy as np
import pytest

from lab.base.files.mission_error import QuestionError
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.log.sensor_log import GnssLog
from lab.data.sheets.sheet_gravity import size_of_gravity
from lab.data.sheets.sheet_imu import Imu
from lab.missions.flight_import import read_log
from lab.motion.frames.earth import SEMI_MAJOR_AXIS

RATE, SPEED, DURATION = 50.0, 40.0, 120.0


def circling(bank, bias=(0.0, 0.0, 0.0)):
    """Return samples (n, 7) and fixes (m, 7) of level flight in coordinated turns of a bank [rad]."""
    rate = STANDARD_GRAVITY * np.tan(bank) / SPEED
    t = np.arange(0, DURATION, 1 / RATE)
    imu = np.zeros((t.size, 7))
    imu[:, 0] = t
    imu[:, 2:4] = rate * np.sin(bank), rate * np.cos(bank)
    imu[:, 6] = -STANDARD_GRAVITY / np.cos(bank)
    noise = np.random.default_rng(1).normal(size=(t.size, 6)) * ((0.002,) * 3 + (0.05,) * 3)
    imu[:, 1:] += noise
    imu[:, 4:] += bias
    at = np.arange(0.0, DURATION, 0.5)
    course = rate * at
    radius = SPEED / max(rate, 1e-12)
    north, east = radius * np.sin(course), radius * (1 - np.cos(course))
    position = np.degrees((0.8 + north / SEMI_MAJOR_AXIS, 0.1 + east / SEMI_MAJOR_AXIS / np.cos(0.8)))
    velocity = SPEED * np.array((np.cos(course), np.sin(course)))
    still = np.full(at.size, 900.0), np.zeros(at.size)
    return imu, np.column_stack((at, *position, still[0], *velocity, still[1]))


@pytest.mark.parametrize("bank", [1.0, 20.0, 35.0, 50.0, 60.0])
def test_gravity_in_turns_is_as_large_as_without(bank):
    """In a turn of bank φ the force is g / cos φ, and so is the change of velocity less gravity."""
    imu, gnss = circling(np.radians(bank))
    fixes = GnssLog(
        gnss[:, 0], np.column_stack((np.radians(gnss[:, 1:3]), gnss[:, 3])), gnss[:, 4:],
        np.full((len(gnss), 3), np.nan), np.full((len(gnss), 3), np.nan), np.zeros(3), 0.0,
    )  # fmt: skip
    for factor in (1.0, 0.980665):
        read = Imu(imu[:, 0], imu[:, 1:] * ((1,) * 3 + (factor,) * 3), None, None, ())
        assert size_of_gravity(read, fixes) == pytest.approx(factor, abs=2e-3)


@pytest.mark.parametrize("bank", [1.0, 25.0, 45.0])
@pytest.mark.parametrize(("per_si", "asked"), [(100.0, True), (1000 / STANDARD_GRAVITY, False)])
def test_turns_do_not_hide_that_the_unit_is_unknown(tmp_path, bank, per_si, asked):
    imu, gnss = circling(np.radians(bank), bias=(0.05, -0.05, 0.05))
    imu[:, 4:] *= per_si
    files = [tmp_path / "imu.csv", tmp_path / "gps.csv"]
    for file, head, rows in zip(
        files, ("t,wx,wy,wz,ax,ay,az", "t,lat,lon,alt,vn,ve,vd"), (imu, gnss), strict=True
    ):
        file.write_text("\n".join((head, *(",".join(f"{x:.10g}" for x in row) for row in rows))))
    if asked:
        with pytest.raises(QuestionError, match=r"98\d for gravity|97\d for gravity") as question:
            read_log(files)
        assert set(question.value.choices) == {"cm/s²", "mg"}
    else:
        remarks = read_log(files).repairs
        assert any("in mg (guessed" in line for line in remarks)
        # A circle has one rate from end to end: no change of it shows that °/s contradict the course.
        assert bank < 20 or any(line.startswith("Gyros: wx, wy, wz of imu.csv, in rad/s") for line in remarks)
