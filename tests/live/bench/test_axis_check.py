"""Axis check: every map is found from simulated positions and turns; what is none is refused, and why."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.data.clock.timed_samples import TIMED_IMU
from lab.data.streams.axis_map import AxisMap
from lab.live.bench.axis_check import POSITIONS, TURNS, AxisCheck
from lab.live.bench.static_interval import AxisCheckError, static_interval
from tests.data.streams.test_axis_map import MAPS

HZ = 100.0
GRAVITY = 9.81
GYRO_NOISE = np.radians(0.015)  # rad/s/√Hz, of a consumer card
FORCE_NOISE = 3e-3  # m/s²/√Hz, 300 µg/√Hz
GYRO_BIAS = np.radians((1.0, -0.6, 0.8))
FORCE_BIAS = np.array((0.2, -0.3, 0.25))  # m/s², forward, right, down
SCALE = np.array((0.02, -0.01, 0.015))


def rows_of(rate: FloatArray, force: FloatArray, seed: int = 1) -> NDArray[np.void]:
    """Return samples with the noise and biases of a consumer card, in the axes of the vehicle."""
    rng = np.random.default_rng(seed)
    rows = np.zeros(len(rate), TIMED_IMU)
    rows["time"] = 100 + np.arange(len(rate)) / HZ
    rows["rate"] = rate + GYRO_BIAS + GYRO_NOISE * np.sqrt(HZ) * rng.normal(size=rate.shape)
    rows["force"] = force * (1 + SCALE) + FORCE_BIAS + FORCE_NOISE * np.sqrt(HZ) * rng.normal(size=rate.shape)
    return rows


def still(name: str, tilt: FloatArray | None = None, seconds: float = 3.0, seed: int = 1) -> NDArray[np.void]:
    """Return a device in a named position, turned from it by a vector [rad]."""
    up = Rotation.from_rotvec(np.zeros(3) if tilt is None else tilt).apply(np.array(POSITIONS[name], float))
    n = round(seconds * HZ)
    return rows_of(np.zeros((n, 3)), np.tile(GRAVITY * up, (n, 1)), seed)


def turn(
    name: str, angle: float = np.pi / 2, off: tuple[float, float, float] = (0, 0, 0)
) -> NDArray[np.void]:
    """Return a turn in 3 s, and stillness before and after it."""
    n = round(6 * HZ)
    axis = np.array(TURNS[name], float) + off
    rate = np.zeros((n, 3))
    rate[n // 4 : 3 * n // 4] = angle / 3 * axis / np.linalg.norm(axis)
    return rows_of(rate, np.tile((0.0, 0.0, -GRAVITY), (n, 1)), 7)


def of_device(rows: NDArray[np.void], mounted: AxisMap) -> NDArray[np.void]:
    """Return samples as the device sends them."""
    rows = rows.copy()
    rows["rate"] = mounted.unmapped(rows["rate"])
    rows["force"] = mounted.unmapped(rows["force"], force=True)
    return rows


def checked(mounted: AxisMap, names: tuple[str, ...]) -> AxisCheck:
    check = AxisCheck()
    for seed, name in enumerate(names):
        rng = np.random.default_rng(seed)
        tilt = rng.normal(size=3)
        tilt *= np.radians(12) / np.linalg.norm(tilt)
        check.take(name, of_device(turn(name) if name in TURNS else still(name, tilt, seed=seed), mounted))
    return check


@pytest.mark.parametrize("axes", MAPS, ids=",".join)
@pytest.mark.parametrize(
    ("inverted", "names"),
    [
        (False, ("level", "nose up")),
        (False, ("left side down", "nose down")),
        (False, ("level", "nose up", "right side down")),
        (False, ("turn right", "turn right side down", "level")),
        (False, (*POSITIONS, *TURNS)),
        (True, ("level", "nose up", "turn right", "turn nose up")),
        (True, (*POSITIONS, *TURNS)),
    ],
)
def test_every_map_is_found(axes: tuple[str, str, str], inverted: bool, names: tuple[str, ...]) -> None:
    mounted = AxisMap(axes, inverted)
    assert checked(mounted, names).result().axes == mounted


def test_six_positions_give_bias_and_scale_factor() -> None:
    mounted = AxisMap.of("y,-x,z,inverted force")
    found = checked(mounted, (*POSITIONS, *TURNS)).result(GRAVITY, 0.0).accelerometer
    assert found is not None
    assert found.bias_sigma.max() < 5e-3  # 3 mm/s²/√Hz over 2 s and 2 positions
    assert found.scale_sigma.max() < 5e-4
    assert (np.abs(found.bias - FORCE_BIAS) < 4 * found.bias_sigma).all()
    assert (np.abs(found.scale - SCALE) < 4 * found.scale_sigma).all()
    unknown = checked(mounted, (*POSITIONS, *TURNS)).result(9.80665).accelerometer
    assert unknown is not None
    assert (np.abs(unknown.scale - SCALE) < 3 * unknown.scale_sigma).all()


def test_the_sentence_of_six_positions_shows_each_sigma_and_minus_signs() -> None:
    check = AxisCheck()
    for name in POSITIONS:
        rows = still(name)
        mean = rows["force"].mean(axis=0)
        rows["force"] = mean + 0.01 * (rows["force"] - mean)  # a σ of 10 µm/s², of a quiet sensor
        check.take(name, rows)
    found = check.result(GRAVITY, 1e-5)
    text = f"{found.sentence} {found.accelerometer} {check.still['level'].gyro_sentence}"
    sigmas = [float(number) for number in re.findall(r"± ([\d.]+)", text)]
    assert len(sigmas) == 9
    assert min(sigmas) > 0
    assert not re.search(r"-[\dxyz]", text)


def test_one_turn_leaves_the_signs_of_two_gyros_unchecked() -> None:
    assert "gyros are not checked" in checked(AxisMap(), (*POSITIONS, "turn right")).result().sentence
    two = checked(AxisMap(), (*POSITIONS, "turn right", "turn nose up")).result()
    assert "not checked" not in two.sentence


def test_sigmas_of_six_positions_are_right() -> None:
    errors = []
    for seed in range(60):
        check = AxisCheck()
        for k, name in enumerate(POSITIONS):
            check.take(name, still(name, seed=10 * seed + k))
        found = check.result(GRAVITY, 0.0).accelerometer
        assert found is not None
        errors.append(
            ((found.bias - FORCE_BIAS) / found.bias_sigma, (found.scale - SCALE) / found.scale_sigma)
        )
    # Each σ is itself estimated from eight blocks, which widens the ratio to that of t with 7 degrees.
    assert 0.8 < np.std(errors) < 1.4


def test_the_gyro_zero_has_the_earths_rate_in_its_sigma() -> None:
    found = static_interval(still("level", seconds=3))
    assert (np.abs(found.rate - GYRO_BIAS) < 4 * found.gyro_bias_sigma).all()
    assert (found.gyro_bias_sigma > 7.292e-5 / np.sqrt(3)).all()
    assert "°/s" in found.gyro_sentence


def refused(check: AxisCheck, name: str, rows: NDArray[np.void]) -> str:
    before = dict(check.positions), dict(check.turns), dict(check.still)
    with pytest.raises(AxisCheckError) as error:
        check.take(name, rows)
    assert (check.positions, check.turns, check.still) == before
    return str(error.value)


def test_a_device_that_moves_while_it_is_taken_is_refused() -> None:
    turning = still("level")
    turning["rate"][:, 2] += np.linspace(0, np.radians(20), len(turning))
    assert "not still" in refused(AxisCheck(), "level", turning)
    swayed = still("level")
    swayed["force"][:, 0] += 2 * np.sin(2 * np.pi * 0.7 * swayed["time"])
    assert "not still" in refused(AxisCheck(), "level", swayed)
    assert "too few" in refused(AxisCheck(), "level", still("level", seconds=1))


def test_a_still_stretch_before_a_jolt_is_found() -> None:
    rows = still("level")
    rows["force"][-60:] += 3 * np.sin(2 * np.pi * 5 * rows["time"][-60:, None])  # as a press of a button
    rows["rate"][-60:] += 0.2
    check = AxisCheck()
    assert check.take("level", rows).shown == (0, 0, -1)


def test_a_position_that_was_just_left_is_not_taken_for_the_new_one() -> None:
    rows = np.concatenate((still("level", seconds=2.4), still("nose up", seconds=0.6)))
    rows["time"] = np.arange(len(rows)) / HZ
    check = AxisCheck()
    assert "was turned" in refused(check, "nose up", rows)
    rows = np.concatenate((still("level"), still("nose up")))
    rows["time"] = np.arange(len(rows)) / HZ
    assert check.take("nose up", rows).shown == (1, 0, 0)  # the last one


def test_what_is_not_vertical_is_refused() -> None:
    check = AxisCheck()
    assert "tilted by 30°" in refused(check, "level", still("level", np.radians((0, 30.0, 0))))
    check.take("level", still("level", np.radians((0, 15.0, 0))))


def test_positions_alike_are_refused() -> None:
    check = AxisCheck()
    check.take("level", still("level"))
    assert "alike" in refused(check, "nose up", still("level"))
    check.take("level", still("level", seed=2))  # again is allowed


def test_wrong_units_are_refused() -> None:
    rows = still("level")
    rows["force"] /= 9.80665
    assert "looks like g" in refused(AxisCheck(), "level", rows)


def test_a_turn_there_and_back_is_refused() -> None:
    there, back = turn("turn right"), turn("turn right", -np.pi / 2)
    rows = np.concatenate((there, back))
    rows["time"] = np.arange(len(rows)) / HZ
    assert "without the way back" in refused(AxisCheck(), "turn right", rows)
    assert "no single axis" in refused(AxisCheck(), "turn right", turn("turn right", off=(0.9, 0, 0)))


def mirrored(rows: NDArray[np.void], field: str, axis: int) -> NDArray[np.void]:
    rows = rows.copy()
    rows[field][:, axis] *= -1
    return rows


def taken(names: tuple[str, ...], field: str, axis: int) -> AxisCheck:
    """Return a check of a device with a wrong sign of one axis of the forces, rates, or both."""
    check = AxisCheck()
    for name in names:
        rows = turn(name) if name in TURNS else still(name)
        for one in ("rate", "force") if field == "both" else (field,):
            rows = mirrored(rows, one, axis)
        check.take(name, rows)
    return check


THREE = ("level", "nose up", "right side down")


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("field", "names", "words"),
    [
        ("force", THREE, "mirror image"),
        ("force", (*THREE, *TURNS), "disagree"),
        ("force", (*POSITIONS, "turn right"), "mirror image|disagree"),
        ("rate", (*THREE, *TURNS), "gyros form a mirror image"),
        ("both", (*THREE, *TURNS), "gyros form a mirror image"),
    ],
)
def test_a_wrong_sign_of_one_axis_is_refused(
    field: str, names: tuple[str, ...], words: str, axis: int
) -> None:
    with pytest.raises(AxisCheckError, match=words):
        taken(names, field, axis).result()


def test_swapped_gyros_disagree() -> None:
    check = AxisCheck()
    for name in (*THREE, "turn right", "turn nose up"):
        rows = turn(name) if name in TURNS else still(name)
        rows["rate"] = rows["rate"][:, [1, 2, 0]]
        check.take(name, rows)
    with pytest.raises(AxisCheckError, match="Gyros and accelerometers disagree"):
        check.result()


def test_contradictions_are_told() -> None:
    check = AxisCheck()
    check.take("level", still("level"))
    check.take("upside down", still("nose up"))
    assert "perpendicular" in check.missing
    check.take("right side down", still("right side down"))
    with pytest.raises(AxisCheckError, match="positions contradict"):
        check.result()
    check.forget()
    assert check.missing


def test_one_position_is_too_few() -> None:
    check = AxisCheck()
    check.take("level", still("level"))
    with pytest.raises(AxisCheckError, match="One more position"):
        check.result()
