"""Axes of a triad in different units, as a sketch with a slip prints them, are found and said."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from further_outputs import COUNT, DEGREE, FORMS, RATE, G, motion, printed

from lab.data.protocols.column_map import Column, ColumnMap
from lab.data.streams.axis_units import AxisUnits
from lab.data.streams.reception import Reception
from lab.data.streams.transport import Chunk

M, RAD = (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)
SI = ColumnMap(
    (
        *(Column(f"rate_{axis}", "rad/s") for axis in "xyz"),
        *(Column(f"force_{axis}", "m/s²") for axis in "xyz"),
    )
)


def received(text: str, reception: Reception | None = None) -> tuple[np.ndarray, Reception]:
    """Return the samples of a text, and what received it."""
    reception = reception or Reception()
    lines = text.splitlines(keepends=True)
    parts = [
        reception.accept(Chunk(n * COUNT / RATE / len(lines), line.encode()))[0]
        for n, line in enumerate(lines)
    ]
    return np.concatenate(parts), reception


def slip(force: tuple[float, ...], rate: tuple[float, ...], seed: int, head: str = "") -> str:
    """Return what a device prints whose axes have units of their own, by their factors to SI."""
    _, f, w = motion(seed)
    rows = np.hstack((f / force, w / rate))
    return head + "".join(",".join(f"{one:.4f}" for one in row) + "\n" for row in rows)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("head", ["", "ax(m/s2),ay(m/s2),az(m/s2),gx(rad/s),gy(rad/s),gz(rad/s)\n"])
@pytest.mark.parametrize(
    ("force", "rate", "words"),
    [
        ((G, G, 1.0), RAD, "specific force are in different units, x and y in g and z in m/s²"),
        ((G, 1.0, 1.0), RAD, "specific force are in different units, x in g and y and z in m/s²"),
        (M, (1.0, 1.0, DEGREE), "rates are in different units, x and y in rad/s and z in °/s"),
        (M, (DEGREE, DEGREE, 1.0), "rates are in different units, x and y in °/s and z in rad/s"),
        (M, (1.0, DEGREE, DEGREE), "rates are in different units, x in rad/s and y and z in °/s"),
    ],
)
def test_the_units_of_each_axis_are_said_and_the_columns_that_are_named_read_them_right(
    force, rate, words, head, seed
):
    text = slip(force, rate, seed, head)
    _, reception = received(text)
    assert words in reception.question
    units = reception.axis_units
    assert units is not None
    for number, column in units.said.items():
        assert f"--column '{number}={column}'" in reception.question
    right, again = received(text, Reception(said=units.said))
    _, f, w = motion(seed)
    np.testing.assert_allclose(right["force"], f[-len(right) :], atol=1e-4 * G)
    np.testing.assert_allclose(right["rate"], w[-len(right) :], atol=1e-4)
    assert not again.question


def test_a_slip_in_both_is_said_one_after_the_other():
    text = slip((G, G, 1.0), (1.0, 1.0, DEGREE), 3)
    _, reception = received(text)
    assert "specific force are in different units" in reception.question
    assert reception.axis_units is not None
    _, second = received(text, Reception(said=reception.axis_units.said))
    assert "x and y in rad/s and z in °/s" in second.question


def test_an_axis_that_has_not_been_tilted_is_not_said_to_be_read_right():
    """While y feels no gravity, g and m/s² explain it alike: nothing is said before it has been tilted."""
    time = np.arange(0, 40, 0.02)
    pitch, roll = 0.6 * np.sin(1.9 * time), np.where(time < 20, 0.0, 0.5 * np.sin(1.3 * time))
    up = np.column_stack((-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)))
    force = G * up + np.random.default_rng(1).normal(0, 0.03, up.shape)
    units = AxisUnits(SI)
    said = []
    for rows in np.split(np.arange(len(time)), len(time) // 50):
        units.add(time[rows], np.zeros((len(rows), 3)), force[rows] / (G, G, 1.0))
        said.append(units.sentence)
    assert not any(said[:20])
    assert all("x and y in g and z in m/s²" in one for one in said if one)
    assert said[-1]


@pytest.mark.parametrize("name", FORMS)
def test_texts_with_one_unit_are_not_contradicted(name):
    _, reception = received(printed(FORMS[name], seed=5)[0])
    assert reception.axis_units is None or not reception.axis_units.sentence


def braking(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Return forces of a car that brakes, gains speed and turns with up to half of g."""
    ahead = 0.5 * np.sin(0.3 * t + rng.uniform(0, 6))
    aside = 0.5 * np.sin(0.17 * t + rng.uniform(0, 6)) ** 3
    return np.column_stack((ahead, aside, np.ones_like(t)))


def biased(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Return forces of a device that lies 3° inclined, whose z misses 0.1 g."""
    return np.array([0.05, 0.02, 0.9]) + 0.003 * rng.standard_normal((t.size, 3))


def thrown(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Return forces of a copter that climbs and falls between 0.5 and 1.6 g, and tilts by 20°."""
    lift = 1.05 + 0.55 * np.sin(1.1 * t + rng.uniform(0, 6))
    return np.column_stack((0.05 * np.sin(0.7 * t), 0.04 * np.cos(0.5 * t), lift))


@pytest.mark.parametrize("made", [braking, biased, thrown])
@pytest.mark.parametrize("seed", range(5))
def test_accelerations_are_no_units(made: Callable[[np.random.Generator, np.ndarray], np.ndarray], seed):
    """As the text of a device, and four times as the numbers that are read from it."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 600, 0.02)
    rows = np.hstack((G * made(rng, t), 0.02 * rng.standard_normal((t.size, 3))))
    rows[:, 5] += 0.6  # turning, so that nothing here is at rest for long
    parts = np.split(np.arange(t.size), t.size // 50)
    if seed:
        units = AxisUnits(SI)
        for part in parts:
            units.add(t[part], rows[part, 3:], rows[part, :3])
            assert not units.sentence
        return
    head = "t(s),ax(m/s2),ay(m/s2),az(m/s2),gx(rad/s),gy(rad/s),gz(rad/s)\n"
    lines = [f"{now:.2f}," + ",".join(f"{one:.4f}" for one in row) for now, row in zip(t, rows, strict=True)]
    reception = Reception()
    for part in parts:
        text = head * (not part[0]) + "\n".join(lines[part[0] : part[-1] + 1]) + "\n"
        reception.accept(Chunk(float(t[part[-1]]), text.encode()))
    assert not reception.question
