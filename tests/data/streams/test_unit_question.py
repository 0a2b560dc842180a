"""A unit that neither header nor numbers name is a question, which a turn, a person or a profile decides."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lab.data.protocols.column_map import ColumnMapError
from lab.data.streams.raw_recording import RawWriter, RecordingError
from lab.data.streams.reception import Reception
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.source import Source
from lab.data.streams.transport import Chunk, TransportError

G = 9.80665
RATE = 60.0
HEADER = "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z\n"


def motion(seconds: float, turn: float = 0.0, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return specific force [m/s²] and rate [rad/s] of a device that is tilted by an angle half-way [rad].

    The truth is in closed form: a rotation about y by a raised cosine of two seconds.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(int(RATE * seconds)) / RATE
    phase = np.clip((t - seconds / 2) / 2.0, 0, 1)
    angle = turn * (1 - np.cos(np.pi * phase)) / 2
    rate = np.zeros((t.size, 3))
    rate[:, 1] = turn * np.pi / 4 * np.sin(np.pi * phase) * ((phase > 0) & (phase < 1))
    # The direction up in axes that turn by +angle about y.
    force = G * np.column_stack((-np.sin(angle), 0 * t, np.cos(angle)))
    bias = np.radians([0.12, -0.15, 0.08])
    return force + 0.02 * rng.standard_normal(force.shape), rate + bias + np.radians(
        0.05
    ) * rng.standard_normal(rate.shape)


def dot(force: np.ndarray, rate: np.ndarray, unit: float) -> list[Chunk]:
    """Return what a Movella DOT writes, line by line; `unit` is that of its rates [rad/s]."""
    chunks = [Chunk(100.0, HEADER.encode())]
    for number, (f, w) in enumerate(zip(force, rate / unit, strict=True)):
        cells = ",".join(f"{one:.6f}" for one in (*f, *w))
        line = f"{number},{192_856_375 + 16_667 * number},{cells}\n"
        chunks.append(Chunk(100.0 + number / RATE, line.encode()))
    return chunks


def received(chunks: list[Chunk], reception: Reception) -> np.ndarray:
    """Return the rates (n, 3) that a source keeps of a stream."""
    rates = np.empty((0, 3))
    for chunk in chunks:
        rows = reception.accept(chunk)[0]
        rates *= reception.taken_factor()
        rates = np.vstack((rates, rows["rate"]))
    return rates


def test_a_still_device_is_in_doubt_and_the_likelier_unit_does_not_move():
    """Read in rad/s it would turn by 12 °/s, and the navigator would never start."""
    force, rate = motion(10.0)
    reception = Reception()
    rates = received(dot(force, rate, np.pi / 180), reception)
    assert reception.doubt == ("°/s", "rad/s")
    assert np.degrees(np.linalg.norm(rates, axis=1)).max() < 1
    reception = Reception()
    rates = received(dot(force, rate, 1.0), reception)
    assert reception.doubt == ("rad/s", "°/s")
    assert np.degrees(np.linalg.norm(rates, axis=1)).max() < 1


@pytest.mark.parametrize("unit", [1.0, np.pi / 180])
@pytest.mark.parametrize("turn", [-35, 25])
@pytest.mark.parametrize("assumed", ["rad/s", "deg/s"])
def test_the_first_turn_decides_whatever_was_assumed(unit, turn, assumed):
    force, rate = motion(12.0, np.radians(turn))
    reception = Reception()
    chunks = dot(force, rate, unit)
    rates = received(chunks[:200], reception)
    reception.answer(assumed)
    # As if the guess had been this one.
    reception.detector.decoder._scale(
        reception.detector.columns.__class__(
            reception.detector.columns.columns,
            doubt=(reception.detector.columns.columns[5].unit, "rad/s", "°/s"),
        )
    )
    rates = np.vstack((rates * reception.taken_factor(), received(chunks[200:], reception)))
    assert not reception.doubt
    assert "first turn" in reception.decided
    np.testing.assert_allclose(rates[-200:], rate[-200:], atol=1e-6)


def test_counts_are_decided_among_the_ranges_of_the_sensor():
    force, rate = motion(12.0, np.radians(60))
    lines = [
        "a/g:\t" + "\t".join(str(round(one)) for one in (*f, *w))
        for f, w in zip(force / G * 4096, np.degrees(rate) * 32.8, strict=True)
    ]
    reception = Reception(rate=RATE)
    chunks = [Chunk(k / RATE, f"{line}\n".encode()) for k, line in enumerate(lines)]
    rates = received(chunks, reception)
    assert str(reception.detector.columns).count("°/s/32.8") == 3
    np.testing.assert_allclose(rates[-100:], rate[-100:], atol=np.radians(0.6 / 32.8))


def test_a_rotation_about_the_vertical_and_hours_of_vibration_decide_nothing():
    rng = np.random.default_rng(3)
    t = np.arange(int(RATE * 600)) / RATE
    force = np.column_stack((0 * t, 0 * t, G + 0 * t)) + 0.6 * rng.standard_normal((t.size, 3))
    rate = np.column_stack((0 * t, 0 * t, 1.5 + 0 * t)) + 0.02 * rng.standard_normal((t.size, 3))
    reception = Reception()
    received(dot(force, rate, np.pi / 180), reception)
    assert reception.doubt or "too fast" in reception.described


def test_samples_do_not_depend_on_how_bytes_arrive():
    force, rate = motion(12.0, np.radians(30))
    chunks = dot(force, rate, np.pi / 180)
    alone = received(chunks, Reception())
    joined = [
        Chunk(chunks[min(k + 7, len(chunks) - 1)].arrival, b"".join(one.data for one in chunks[k : k + 8]))
        for k in range(0, len(chunks), 8)
    ]
    together = received(joined, Reception())
    np.testing.assert_allclose(together, alone, rtol=1e-12)


def test_what_a_person_says_holds_from_the_beginning_and_is_checked():
    force, rate = motion(6.0)
    reception = Reception(units={"rate": "deg/s"})
    rates = received(dot(force, rate, np.pi / 180), reception)
    assert not reception.doubt
    np.testing.assert_allclose(rates, rate[-len(rates) :], atol=1e-7)
    with pytest.raises(ColumnMapError, match=r"'lb' is no unit of it; accepted are °/s"):
        Reception(units={"rate": "lb"})
    with pytest.raises(ColumnMapError, match="'speeed' is no quantity"):
        Reception(units={"speeed": "m/s"})
    with pytest.raises(TransportError, match="columns are of text lines"):
        Reception("vectornav", units={"rate": "deg/s"})


def test_a_recording_knows_the_question_and_its_answer(tmp_path):
    force, rate = motion(12.0, np.radians(40))
    chunks = dot(force, rate, np.pi / 180)
    live = Reception()
    rates = received(chunks, live)
    whole = tmp_path / "whole.inslab"
    writer = RawWriter(whole, {"protocol": "", "columns": "", "axes": "x,y,z", "rate": 0.0})
    for chunk in chunks:
        writer.accept(chunk)
    writer.close()
    again = recorded_samples(whole)
    np.testing.assert_allclose(again.imu["rate"], rates, rtol=1e-12)
    # Begun in the midst of the stream, before the turn: the header says that the unit is in doubt.
    live = Reception()
    received(chunks[:250], live)
    part = tmp_path / "part.inslab"
    header = {
        "protocol": live.detector.protocol, "columns": str(live.detector.columns), "doubt": list(live.doubt),
        "axes": "x,y,z", "rate": live.imu.rate, "clock": live.imu.clock.state, "watch": live.imu.watch.state,
        "counted": live.imu.counted,
    }  # fmt: skip
    writer = RawWriter(part, header)
    for chunk in chunks[250:]:
        writer.accept(chunk)
    writer.tell(200.0, {"rate unit": "deg/s"})
    writer.close()
    again = recorded_samples(part)
    assert not again.reception.doubt
    np.testing.assert_allclose(again.imu["rate"], rates[-len(again.imu) :], rtol=1e-12)
    assert recorded_samples(part, unit="rate=rad/s").imu["rate"][-1] == pytest.approx(
        np.degrees(rates[-1]), rel=1e-9
    )


def test_the_source_gives_all_samples_the_unit_that_was_said():
    force, rate = motion(6.0)
    chunks = dot(force, rate, 1.0)

    class Fed:
        address, reconnects = "fed", False

        def open(self) -> None: ...

        def close(self) -> None: ...

        def read(self, longest: float) -> Chunk:
            if not chunks:
                raise EOFError("All was sent.")
            return chunks.pop(0)

    source = Source(Fed(), Reception())
    with source:
        source._thread.join()
        assert source.status.doubt == ("rad/s", "°/s")
        assert "--unit rate=°/s" in source.status.question
        before = source.since().imu["rate"]
        source.answer("deg/s")
        np.testing.assert_allclose(source.since().imu["rate"], before * np.pi / 180, rtol=1e-15)
        assert source.rescaled == 1
        assert source.status.doubt == ()
        assert "as you said" in source.status.evidence
        assert all(one.text for one, _ in pairwise(source.status.events))


@pytest.mark.parametrize(
    "event", [{"rate unit": "lb"}, {"rate unit": [1]}, {"columns": "1=moon[m/s]"}, {"columns": "nothing"}]
)
def test_an_answer_in_a_recording_that_is_none_is_refused(event, tmp_path):
    force, rate = motion(6.0)
    path = tmp_path / "hostile.inslab"
    writer = RawWriter(
        path, {"protocol": "", "columns": "", "axes": "x,y,z", "rate": 0.0, "doubt": ["lb", 7]}
    )
    for chunk in dot(force, rate, 1.0):
        writer.accept(chunk)
    writer.tell(110.0, event)
    writer.close()
    with pytest.raises((RecordingError, TransportError), match="accepted"):
        recorded_samples(path)
