"""BNO085 in the mode UART-RVC: the maker's example, and rates that add up to its attitude."""

from __future__ import annotations

import numpy as np
import pytest
from live_streams import decoded, fixes, motion
from scipy.spatial.transform import Rotation

from lab.data.protocols.bno085 import Bno085Encoder
from lab.data.protocols.catalogue import make_decoder

EXAMPLE = bytes.fromhex("aaaade010092ff25088dfeecffd103000000e7")
"""Of the data sheet: number 222, yaw 0.01°, pitch -1.10°, roll 20.85°, -371, -20 and 977 mg."""


def test_the_example_of_the_data_sheet_feels_gravity_where_its_angles_say():
    (row,) = decoded(make_decoder("bno085"), EXAMPLE).imu
    assert row["count"] == 222
    assert row["force"] == pytest.approx(9.80665e-3 * np.array([-371, -20, 977]))
    assert np.isnan(row["rate"]).all()
    up = Rotation.from_euler("ZXY", [0.01, -1.10, 20.85], degrees=True).inv().apply([0, 0, 1])
    assert row["force"] / np.linalg.norm(row["force"]) == pytest.approx(up, abs=2e-3)


def frame(number: int, attitude: Rotation) -> bytes:
    angles = np.rint(100 * attitude.as_euler("ZXY", degrees=True)).astype("<i2")
    body = bytes((number % 256,)) + angles.tobytes() + bytes(9)
    return b"\xaa\xaa" + body + bytes((sum(body) & 255,))


def test_rates_turn_one_attitude_into_the_next_across_the_turn_of_the_yaw_and_lost_frames():
    turn = np.array([0.4, -0.3, 2.0])
    attitudes = [Rotation.from_rotvec(turn * 0.01 * k) for k in range(600)]
    lost = {100, 101, 102, 255, 256}
    data = b"".join(frame(k + 250, one) for k, one in enumerate(attitudes) if k not in lost)
    imu = decoded(make_decoder("bno085"), data).imu
    assert np.diff(imu["count"]).sum() == 599
    np.testing.assert_allclose(imu["rate"][1:].mean(axis=0), turn, atol=2e-3)
    assert np.abs(imu["rate"][1:] - turn).max() < np.radians(2.0)  # angles are rounded to 0.01°
    found = Rotation.identity()
    for steps, rate in zip(np.diff(imu["count"]), imu["rate"][1:], strict=True):
        found *= Rotation.from_rotvec(rate * 0.01 * steps)
    assert (attitudes[-1].inv() * found).magnitude() < np.radians(0.02)  # errors do not add up


def test_what_is_encoded_turns_as_the_motion_does():
    imu = motion(200)
    found = decoded(make_decoder("bno085"), Bno085Encoder().encode(imu, fixes(0))).imu
    np.testing.assert_allclose(found["force"], imu["force"], atol=5e-3)
    np.testing.assert_allclose(found["rate"][1:].mean(axis=0), imu["rate"][1:].mean(axis=0), atol=2e-3)
