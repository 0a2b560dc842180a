"""Texts of published programs: their values come, and two devices on one cable are never mixed."""

from __future__ import annotations

import numpy as np
import pytest
from further_outputs import COUNT, RATE, Form, motion, printed
from sketch_outputs import SKETCHES, TWO_DEVICES, of_two_devices
from test_further_outputs import received

from lab.data.protocols.column_guess import guess_columns
from lab.data.protocols.column_map import Column, ColumnMap, ColumnMapError
from lab.data.protocols.text_lines import TextLines


@pytest.mark.parametrize("name", SKETCHES)
def test_a_sketch_has_the_values_that_were_printed(name):
    form = SKETCHES[name]
    text, force, rate = printed(form, seed=3)
    imu, reception, _ = received(text)
    count = len(imu)
    assert COUNT - 4 <= count <= COUNT, reception.described
    end = COUNT if np.allclose(imu["force"][-1], force[-1]) else COUNT - 1
    np.testing.assert_allclose(imu["force"], force[end - count : end], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(imu["rate"], rate[end - count : end], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.diff(imu["time"]), 1 / RATE, atol=2e-4)


@pytest.mark.parametrize("name", TWO_DEVICES)
def test_lines_of_two_devices_are_not_mixed(name):
    text, forces, rates = of_two_devices(TWO_DEVICES[name], seed=5)
    imu, reception, _ = received(text)
    count = len(imu)
    assert COUNT - 4 <= count <= COUNT, reception.described
    mine = [
        np.allclose(imu["force"], force[end - count : end])
        and np.allclose(imu["rate"], rate[end - count : end])
        for force, rate in zip(forces, rates, strict=True)
        for end in range(count, COUNT + 1)
    ]
    assert sum(mine) == 1
    np.testing.assert_allclose(np.diff(imu["time"]), 1 / RATE, atol=2e-4)
    if "source[" in reception.described:
        assert "The lines are of 2 devices" in reception.described
    else:
        assert "as of another device" in reception.described or "a second IMU" in reception.described


@pytest.mark.parametrize(
    ("name", "place"), [("word_and_number", 1), ("number_behind_time", 2), ("labelled", 1)]
)
def test_the_other_device_is_read_by_its_name(name, place):
    text, forces, rates = of_two_devices(TWO_DEVICES[name], seed=6)
    decoder = TextLines(said={str(place): "source[2]"} | _said(text, place))
    imu = decoder.feed(text.encode()).imu
    assert COUNT - 1 <= len(imu) <= COUNT
    np.testing.assert_allclose(imu["force"], forces[1][-len(imu) :], rtol=1e-9)
    np.testing.assert_allclose(imu["rate"], rates[1][-len(imu) :], rtol=1e-9)
    assert decoder.statistics.skipped < 100


def _said(text: str, place: int) -> dict[str, str]:
    """Return what a person says of the other columns."""
    columns = guess_columns(text.splitlines())
    assert columns is not None
    return {str(at): str(one) for at, one in enumerate(columns.columns, 1) if at != place}


def test_a_map_with_a_device_is_read_as_it_is_shown():
    text, forces, _ = of_two_devices(TWO_DEVICES["labelled"], seed=7)
    shown = str(guess_columns(text.splitlines())).replace("source[1]", "source[2]")
    imu = TextLines(ColumnMap.of(shown)).feed(text.encode()).imu
    np.testing.assert_allclose(imu["force"], forces[1], rtol=1e-9)
    with pytest.raises(ColumnMapError, match=r"accepted is what they hold, such as source\[2\]"):
        Column.of("source").check()


def test_the_column_of_times_is_named_by_its_place():
    text, _, _ = of_two_devices(TWO_DEVICES["word_number_time"], seed=7)
    found = guess_columns(text.splitlines())
    assert found is not None
    times = [one for one in found.remarks if one.startswith("time:")]
    assert times == ["time: column 2 increases by 20 a line: 50 Hz if it is in ms."]


def test_devices_at_different_rates_and_with_lost_lines_are_not_mixed():
    rng = np.random.default_rng(8)
    text, forces, _ = of_two_devices(TWO_DEVICES["number_behind_time"], seed=8)
    lines = text.splitlines(keepends=True)
    kept = [line for n, line in enumerate(lines) if (n % 2 == 0 or n % 4 == 1) and rng.random() > 0.02]
    imu, _, _ = received("".join(kept))
    assert (np.isclose(imu["force"][:, None], forces[0]).all(axis=2).any(axis=1)).all()


def test_a_sensor_at_half_the_rate_is_read_with_the_other():
    """The faster one alone would be rates without forces."""
    _, force, rate = motion(3)
    three = "{0[0]:.4f},{0[1]:.4f},{0[2]:.4f}\n"
    imu, reception, _ = received(
        "".join(
            f"G,{20_000 * n},{three.format(rate[n])}"
            + (f"A,{20_000 * n},{three.format(force[n])}" if n % 2 == 0 else "")
            for n in range(COUNT)
        )
    )
    assert COUNT / 2 - 4 <= len(imu) <= COUNT / 2, reception.described
    at = [int(np.argmin(np.abs(force - one).sum(axis=1))) for one in imu["force"]]
    np.testing.assert_allclose(imu["force"], force[at], atol=1e-4)
    np.testing.assert_allclose(np.diff(at), 2)
    np.testing.assert_allclose(imu["rate"], rate[np.add(at, 1)], atol=1e-4)


PLACES = {
    "a_line": "LAT={0:.6f} LONG={1:.6f} ALT={2:.2f} SAT=9 DOP=0.90\r\n",
    "brackets": "Location:\t(Latitude: {0:.6f}, Longitude: {1:.6f}, Altitude: {2:.2f})\r\n",
    "navsatfix": "header:\n  stamp:\n    sec: 17000000{n:02}\n    nanosec: 0\n  frame_id: gps\n"
    "status:\n  status: 0\n  service: 1\nlatitude: {0:.6f}\nlongitude: {1:.6f}\naltitude: {2:.2f}\n"
    "position_covariance:\n" + "- 1.0\n- 0.0\n- 0.0\n" * 3 + "position_covariance_type: 2\n---\n",
}  # fmt: skip
"""Texts of receivers alone."""


@pytest.mark.parametrize("name", PLACES)
def test_positions_without_an_imu_are_fixes(name):
    places = [(47.37 + 2e-6 * n, 8.54 + 3e-6 * n, 430.1 + 0.1 * n) for n in range(40)]
    decoder = TextLines()
    found = decoder.feed("".join(PLACES[name].format(*one, n=n) for n, one in enumerate(places)).encode())
    assert not len(found.imu), decoder.evidence
    got = np.column_stack([found.fix[one] for one in ("latitude", "longitude", "height")])
    got[:, :2] = np.degrees(got[:, :2])
    np.testing.assert_allclose(got, places[-len(got) :], atol=1e-6)
    assert len(got) >= 39


STILL = {
    "a_flag": lambda n, _rng: n % 2,
    "a_number_of_two_bits": lambda n, _rng: n % 4,
    "a_state": lambda n, _rng: ("OK", "WAIT")[n % 2],
    "a_quality": lambda _n, rng: rng.integers(0, 4),
}
"""What takes turns in the lines of one device."""


@pytest.mark.parametrize("still", [False, True])
@pytest.mark.parametrize("name", STILL)
@pytest.mark.parametrize("form", ["{ms},{f},{w},{it}\n", "id,{it},{f},{w}\n", "$IMU,{f},{w},{it}\n"])
def test_what_else_takes_turns_parts_no_lines(form, name, still):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        _, force, rate = motion(seed)
        if still:
            force = force[0] + 0.03 * rng.standard_normal(force.shape)
            rate = rate[0] + 0.002 * rng.standard_normal(rate.shape)
        lines = [
            form.format(
                f=",".join(f"{x:.3f}" for x in force[n]), w=",".join(f"{x:.4f}" for x in rate[n]), ms=20 * n,
                it=STILL[name](n, rng),
            )
            for n in range(200)
        ]  # fmt: skip
        decoder = TextLines()
        rows = decoder.feed("".join(lines).encode()).imu
        assert len(rows) + len(decoder.finish().imu) >= 198, decoder.evidence


@pytest.mark.parametrize(
    ("force", "rate"), [("mg", "mrad"), ("m", "mdps"), ("g", "mdps"), ("m", "deg"), ("g", "rad")]
)
def test_a_turn_shows_units_that_do_not_belong_together(force, rate):
    form = Form("@F,@W\n", force, rate, decimals=3)
    text, forces, rates = printed(form, seed=9)
    imu, reception, asked = received(text)
    assert asked
    assert "first turn" in reception.decided
    count = len(imu)
    assert count >= COUNT - 4
    np.testing.assert_allclose(imu["force"], forces[-count:], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(imu["rate"], rates[-count:], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "names", ["\u00b2 \u00b3", "a;b c,d", "{x} [y]", f"{'9' * 30} {'8' * 30}", "{0} {1}"]
)
def test_any_names_of_devices_are_read_or_left(names):
    text, forces, _ = of_two_devices("{side}\t@F\t@W\n", seed=10)
    one, other = names.split()
    text = text.replace("left", one).replace("right", other).replace(",", "\t" if "," not in names else ",")
    decoder = TextLines()
    imu = decoder.feed(text.encode()).imu
    shown = decoder.columns
    assert shown is None or ColumnMap.of(str(shown)) == shown
    assert not len(imu) or any(np.allclose(imu["force"], force[-len(imu) :]) for force in forces)
    six = [
        f"{name}_{axis}[{unit}]" for name, unit in (("force", "m/s²"), ("rate", "rad/s")) for axis in "xyz"
    ]
    said = {"1": f"source[{one}]"} | {str(at): column for at, column in enumerate(six, 2)}
    TextLines(said=said).feed(text.encode())
