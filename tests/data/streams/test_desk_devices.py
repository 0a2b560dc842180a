"""What devices on a desk do: slow and fast clocks, repeated packets, another device on the cable."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from further_outputs import DEGREE, G

from lab.data.protocols.catalogue import ENCODERS
from lab.data.protocols.samples import FIX, IMU
from lab.data.streams.raw_recording import DEVICE_LOST, RawWriter
from lab.data.streams.reception import Reception
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.transport import Chunk

TRUE_FORCE, TRUE_RATE = np.array([0.1, -0.2, -9.8]), np.array([0.002, -0.001, 0.003])


def at_rest(count: int, rate: float, begin: float = 10.0, seed: int = 0) -> np.ndarray:
    """Return samples of a device at rest."""
    rng = np.random.default_rng(seed)
    rows = np.zeros(count, IMU)
    rows["time"] = begin + np.arange(count) / rate
    rows["force"] = TRUE_FORCE + 0.02 * rng.standard_normal((count, 3))
    rows["rate"] = TRUE_RATE + 1e-3 * rng.standard_normal((count, 3))
    return rows


def lines(
    rows: np.ndarray, clock: Callable[[float], str] | None = None, force: float = 1.0, rate: float = 1.0
) -> list[bytes]:
    """Return a line of text for each sample."""
    begin = ["" if clock is None else f"{clock(row['time'])}," for row in rows]
    values = np.hstack((rows["force"] / force, rows["rate"] / rate))
    cells = [",".join(f"{one:.4f}" for one in row) for row in values]
    return [f"{one}{more}\n".encode() for one, more in zip(begin, cells, strict=True)]


def binary(rows: np.ndarray) -> list[bytes]:
    """Return frames of a VectorNav."""
    encoder = ENCODERS["vectornav"]()
    return [encoder.encode(rows[k : k + 1], np.empty(0, FIX)) for k in range(len(rows))]


def chunks(parts: list[bytes], rate: float, begin: float = 100.0, together: int = 1) -> list[Chunk]:
    """Return parts as they arrive."""
    return [
        Chunk(begin + k / rate, b"".join(parts[k : k + together])) for k in range(0, len(parts), together)
    ]


def received(reception: Reception, stream: list[Chunk]) -> np.ndarray:
    """Return the samples of a stream."""
    return np.concatenate([reception.accept(chunk)[0] for chunk in stream])


def milliseconds(time: float) -> str:
    """Return a time in whole milliseconds."""
    return str(round(1e3 * time))


def microseconds(time: float) -> str:
    """Return a time in whole microseconds."""
    return str(round(1e6 * time))


@pytest.mark.parametrize(
    ("rate", "clock", "unit", "seconds"), [(1, milliseconds, "ms", 60), (4000, microseconds, "µs", 12)]
)
def test_times_that_pass_a_thousand_times_too_fast_or_slowly_are_in_another_unit(rate, clock, unit, seconds):
    """A step of 1000 may be a second in ms or a millisecond in µs: the arrival decides."""
    parts = lines(at_rest(rate * seconds, rate), clock)
    reception = Reception()
    imu = received(reception, chunks(parts, rate, together=max(1, rate // 250)))
    assert f"The times are in {unit}, not in " in reception.described
    last = imu[imu["arrival"] > 100 + seconds / 2 + 3]
    steps = np.diff(last["time"])
    assert np.median(steps) == pytest.approx(1 / rate, rel=1e-3)
    assert steps.max() < 1.5 / rate
    assert np.abs(last["time"] - last["arrival"]).max() < 0.3


@pytest.mark.parametrize("clock", [milliseconds, lambda time: f"{time:.3f}"])
def test_right_times_keep_their_unit_whatever_the_network_does(clock):
    parts = chunks(lines(at_rest(4000, 100), clock), 100)
    late = [Chunk(100 + 4.0 * np.ceil((one.arrival - 100) / 4), one.data) for one in parts]
    reception = Reception()
    imu = received(reception, late)
    assert "The times are in" not in reception.described
    assert np.median(np.diff(imu["time"])) == pytest.approx(0.01, rel=1e-3)


def test_lines_that_come_twice_are_one_sample_each():
    parts = lines(at_rest(1000, 100), milliseconds)
    reception = Reception()
    imu = received(reception, [one for one in chunks(parts, 100) for _ in range(2)])
    assert len(imu) == 1000
    assert reception.loss.repeated >= 999
    assert np.median(np.diff(imu["time"])) == pytest.approx(0.01, rel=1e-3)


def sketch(rows: np.ndarray) -> list[bytes]:
    """Return lines in g and °/s, with tabulators and without a time."""
    return [line.replace(b",", b"\t") for line in lines(rows, None, G, DEGREE)]


def clocked(rows: np.ndarray) -> list[bytes]:
    """Return lines in m/s² and rad/s with a time."""
    return lines(rows, milliseconds)


@pytest.mark.parametrize(("first", "second"), [(clocked, sketch), (clocked, binary), (binary, clocked)])
def test_another_device_on_the_cable_is_read_without_being_told(first, second):
    reception = Reception()
    received(reception, chunks(first(at_rest(500, 100)), 100))
    reception.lose(106.0)
    imu = received(reception, chunks(second(at_rest(800, 100, seed=3)), 100, 110.0))
    assert len(imu) >= 798
    np.testing.assert_allclose(np.median(imu["force"], axis=0), TRUE_FORCE, atol=0.01)
    np.testing.assert_allclose(np.median(imu["rate"], axis=0), TRUE_RATE, atol=3e-4)


def test_the_same_device_again_loses_nothing():
    for form in (clocked, sketch, binary):
        reception = Reception()
        received(reception, chunks(form(at_rest(500, 100)), 100))
        reception.lose(106.0)
        imu = received(reception, chunks(form(at_rest(500, 100, 20.0)), 100, 110.0)[:20])
        assert len(imu) >= (18 if reception.imu.rate == 0 else 0)


def test_a_header_after_a_restart_names_the_units_that_follow():
    def head(force: str, rate: str) -> bytes:
        names = [f"{one}{axis}({unit})" for one, unit in (("a", force), ("g", rate)) for axis in "xyz"]
        return (",".join(names) + "\n").encode()

    begun = [head("m/s2", "rad/s"), *lines(at_rest(500, 100))]
    again = [b"BOOT v2\r\n", head("g", "dps"), *lines(at_rest(800, 100, seed=2), None, G, DEGREE)]
    reception = Reception()
    imu = received(reception, chunks(begun, 100) + chunks(again, 100, 107.0))
    assert len(imu) == 1300
    for part in (imu[:500], imu[500:]):
        np.testing.assert_allclose(np.median(part["force"], axis=0), TRUE_FORCE, atol=0.02)
        np.testing.assert_allclose(np.median(part["rate"], axis=0), TRUE_RATE, atol=3e-4)


def test_other_units_after_a_restart_without_a_header_are_asked():
    begun = lines(at_rest(500, 100))
    again = [b"BOOT v2\r\n", *lines(at_rest(1200, 100, seed=2), None, G, DEGREE)]
    reception = Reception()
    received(reception, chunks(begun, 100) + chunks(again, 100, 107.0))
    assert "The specific force is in g now" in reception.question
    assert "--column '1=force_x[g]'" in reception.question


@pytest.mark.parametrize("mark", [";", "\t", " "])
def test_numbers_with_a_decimal_comma_are_read_if_their_separator_is_another_sign(mark):
    parts = [
        line.replace(b",", mark.encode()).replace(b".", b",")
        for line in lines(at_rest(300, 100), milliseconds)
    ]
    imu = received(Reception(), chunks(parts, 100))
    np.testing.assert_allclose(np.median(imu["force"], axis=0), TRUE_FORCE, atol=0.01)


def test_numbers_with_a_decimal_comma_between_commas_are_never_guessed():
    parts = [line.replace(b".", b",") for line in lines(at_rest(300, 100), milliseconds)]
    reception = Reception()
    assert not len(received(reception, chunks(parts, 100)))
    assert len(reception.detector.last_lines) == 3


def test_sentences_of_a_receiver_without_a_check_are_no_imu():
    text = "".join(
        f"$GNGGA,1000{k // 5:02d}.{k % 5 * 2}0,4718.00000,N,00830.00000,E,4,12,0.8,430.1,M,47.0,M,,\r\n"
        f"$GNRMC,1000{k // 5:02d}.{k % 5 * 2}0,A,4718.00000,N,00830.00000,E,0.0,45.0,301126,,,A\r\n"
        for k in range(100)
    )
    reception = Reception()
    assert not len(received(reception, chunks(text.encode().splitlines(keepends=True), 10)))
    assert "without a check" in reception.detector.evidence


def test_a_recording_of_a_change_of_the_device_gives_the_same_samples(tmp_path: Path):
    def head(force: str) -> bytes:
        return (
            ",".join([f"a{axis}({force})" for axis in "xyz"] + [f"g{axis}(rad/s)" for axis in "xyz"]) + "\n"
        ).encode()

    first = chunks([head("m/s2"), *lines(at_rest(300, 100))], 100)
    again = chunks([head("g"), *lines(at_rest(300, 100, seed=2), None, G)], 100, 107.0)
    other = chunks(binary(at_rest(300, 100, seed=3)), 100, 115.0)
    live = Reception()
    received(live, first)
    path = tmp_path / "change.inslab"
    writer = RawWriter(path, live.header)
    parts = []
    for stream in (again, other):
        for chunk in stream:
            writer.accept(chunk)
        parts += [received(live, stream), live.lose(stream[-1].arrival)[0]]
        writer.tell(stream[-1].arrival, {DEVICE_LOST: "unplugged"})
    writer.close()
    seen = np.concatenate(parts)
    np.testing.assert_allclose(np.median(seen["force"], axis=0), TRUE_FORCE, atol=0.02)
    recorded = recorded_samples(path).imu
    for name in ("rate", "force", "arrival"):
        assert recorded[name].tobytes() == seen[name].tobytes(), name
    assert (recorded["gap"][1:] == seen["gap"][1:]).all()  # a recording begins with a gap
    np.testing.assert_allclose(recorded["time"], seen["time"], atol=0.02)


def test_columns_that_a_person_named_are_kept_whatever_a_header_says():
    named = "force_x[m/s²],force_y[m/s²],force_z[m/s²],rate_x[rad/s],rate_y[rad/s],rate_z[rad/s]"
    reception = Reception(columns=named)
    parts = lines(at_rest(500, 100))
    parts[300:300] = [b"ax(g),ay(g),az(g),gx(dps),gy(dps),gz(dps)\n"]
    imu = received(reception, chunks(parts, 100))
    np.testing.assert_allclose(np.median(imu["force"][320:], axis=0), TRUE_FORCE, atol=0.02)
