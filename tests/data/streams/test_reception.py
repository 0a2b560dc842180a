"""Reception: streams whose truth is known become timed samples, whatever is wrong with them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from live_streams import capture, damaged, fixes, motion

from lab.data.clock.clock_watch import common_step
from lab.data.clock.limits import LIMITS
from lab.data.protocols.catalogue import ENCODERS
from lab.data.protocols.decoder import Statistics
from lab.data.protocols.samples import FIX, IMU, Samples
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.imu_clock import nominal_rate
from lab.data.streams.reception import Reception
from lab.data.streams.recorded_log import make_reception
from lab.data.streams.transport import Chunk

HOST = 5000.0
"""Time of the host at time 7 of the device [s]."""
IMU_DEVICES = ("vectornav", "xsens", "mip", "memsense", "ublox", "mavlink", "text")


def chunks(device: str, imu: np.ndarray, fix: np.ndarray | None = None, many: int = 1) -> list[Chunk]:
    """Return what a device sends, arriving 1 ms after the last sample of each group."""
    encoder = ENCODERS[device]()
    made = []
    for begin in range(0, len(imu), many):
        rows = imu[begin : begin + many]
        end = rows["time"][-1]
        due = fix[(fix["time"] <= end) & (fix["time"] > rows["time"][0] - 0.01)] if fix is not None else []
        data = encoder.encode(rows, np.empty(0, FIX))
        data += encoder.encode(np.empty(0, IMU), due) if len(due) else b""
        made.append(Chunk(HOST + end - 7.0 + 1e-3, data))
    return made


def received(reception: Reception, stream: list[Chunk]) -> tuple[np.ndarray, np.ndarray]:
    parts = [reception.accept(chunk) for chunk in stream]
    parts.append(reception.lose(stream[-1].arrival))
    return np.concatenate([imu for imu, _ in parts]), np.concatenate([fix for _, fix in parts])


@pytest.mark.proof
@pytest.mark.parametrize("device", IMU_DEVICES)
@pytest.mark.parametrize("known", [False, True])
def test_every_device_is_recognised_and_timed(device: str, known: bool) -> None:
    sent = motion(1500)
    reception = Reception(device if known else "")
    imu, _ = received(reception, chunks(device, sent))
    assert reception.detector.protocol == device
    assert len(imu) >= len(sent) - (3 if device == "text" else 1)
    true = HOST + sent["time"][-len(imu) :] - 7.0
    error = imu["time"] - true
    assert np.abs(error[800:] - 1e-3).max() < 2e-3  # the delay of 1 ms cannot be told from the offset
    assert (np.diff(imu["time"]) > 0).all()
    assert not imu["gap"][1:].any()
    assert reception.imu.timing
    assert np.abs(imu["rate"] - sent["rate"][-len(imu) :]).max() < 0.01
    if not known:
        assert "frames" in reception.detector.evidence or "lines" in reception.detector.evidence


@pytest.mark.parametrize("device", ["vectornav", "xsens", "mip", "ublox", "mavlink", "text"])
@pytest.mark.parametrize("apart", [False, True])
def test_a_datagram_that_a_network_delivers_twice_is_used_once(device: str, apart: bool) -> None:
    """Datagrams hold several samples; the second copy comes at once, or after the next datagram."""
    sent = motion(1500)
    stream: list[Chunk] = []
    for k, chunk in enumerate(chunks(device, sent, many=5)):
        stream.append(chunk)
        if k > 100 and k % 3 == 0:
            stream.append(Chunk(chunk.arrival + 1e-4, (stream[-2] if apart else chunk).data))
    reception = Reception(device)
    imu, _ = received(reception, stream)
    assert len(imu) == len(sent)
    assert np.abs(imu["rate"] - sent["rate"]).max() < 0.01
    assert reception.imu.watch.repeated == 5 * (len(stream) - 300)
    assert (reception.loss.jumps, reception.loss.missing) == (0, 0)
    true = HOST + sent["time"] - 7.0
    assert np.abs(imu["time"] - true)[800:].max() < 0.06  # 40 ms until a datagram of five is complete


def test_a_busy_computer_adds_no_turn_to_a_counter_of_a_seventh_of_a_second() -> None:
    """All samples come, but those of 0.16 s stall on their way: the first alone, the others at once later."""
    sent = motion(1500)
    stream = chunks("memsense", sent)
    for begin in range(300, 1400, 100):
        late = stream[begin + 16].arrival
        for k in range(begin, begin + 17):
            stream[k] = Chunk(late + 1e-5 * (k - begin), stream[k].data)
    reception = Reception("memsense")
    imu, _ = received(reception, stream)
    assert len(imu) == len(sent)
    assert reception.loss.missing == reception.loss.jumps == 0
    assert np.abs(np.diff(imu["time"]) - 0.01)[800:].max() < 1e-3


def test_fixes_of_the_same_clock_lie_among_the_samples() -> None:
    sent, sent_fix = motion(1500), fixes(14)
    imu, fix = received(Reception("vectornav"), chunks("vectornav", sent, sent_fix))
    assert len(fix) == len(sent_fix)
    at = np.interp(fix["time"], imu["time"], sent["time"][: len(imu)])
    assert np.abs(at - sent_fix["time"]).max() < 1e-3
    assert np.allclose(fix["latitude"], sent_fix["latitude"], atol=1e-9)


def test_fixes_of_another_clock_are_mapped_by_their_own() -> None:
    sent_fix = fixes(30)
    stream = [
        Chunk(
            HOST + row["utc"] - sent_fix["utc"][0] + 0.05,
            ENCODERS["nmea"]().encode(np.empty(0, IMU), row[None]),
        )
        for row in sent_fix
    ]
    _, fix = received(Reception("nmea"), stream)
    assert len(fix) == len(sent_fix)
    true = HOST + sent_fix["utc"] - sent_fix["utc"][0]
    assert np.abs(fix["time"] + LIMITS.latency - 0.05 - true).max() < 5e-3  # they are sent 0.05 s after
    assert np.abs(np.diff(fix["time"]) - 1).max() < 1e-3


def test_samples_are_counted_where_the_device_has_no_clock() -> None:
    sent = motion(2000)
    sent["time"] = np.nan
    lines = [
        Chunk(
            HOST + 0.01 * k + 1e-3,
            ",".join(f"{x:.6f}" for x in (*row["rate"], *row["force"])).encode() + b"\n",
        )
        for k, row in enumerate(sent)
    ]
    columns = "rate_x[rad/s],rate_y[rad/s],rate_z[rad/s],force_x[m/s²],force_y[m/s²],force_z[m/s²]"
    reception = Reception(columns=columns)
    imu, _ = received(reception, lines)
    assert reception.imu.rate == 100.0
    assert reception.imu.timing == "by the number of samples at 100 Hz, measured"
    assert len(imu) >= 1998
    assert np.abs(np.diff(imu["time"]) - 0.01).max() < 1e-4
    given = Reception(columns=columns, rate=100.0)
    received(given, lines)
    assert given.imu.timing.endswith("given")


def counted_lines(rate: float, seconds: float, busy: float = 0.0, seed: int = 1) -> list[Chunk]:
    """Return lines without a time; the host is late by a random delay of this mean [s]."""
    rng = np.random.default_rng(seed)
    sent = motion(int(rate * seconds))
    due = HOST + np.arange(len(sent)) / rate
    arrival = np.maximum.accumulate(due + busy * rng.standard_exponential(len(sent)))
    return [
        Chunk(float(when), ",".join(f"{x:.6f}" for x in (*row["rate"], *row["force"])).encode() + b"\n")
        for when, row in zip(arrival, sent, strict=True)
    ]


RATES_OF_TEXT = "rate_x[rad/s],rate_y[rad/s],rate_z[rad/s],force_x[m/s²],force_y[m/s²],force_z[m/s²]"


@pytest.mark.parametrize(("rate", "busy"), [(98.5, 0.0), (19.5, 0.005), (204.0, 0.01), (100.0, 0.05)])
def test_a_device_near_a_usual_rate_is_counted_at_its_own(rate: float, busy: float) -> None:
    """Its first two seconds cannot tell 98.5 Hz from 100 Hz; the minute after them can."""
    reception = Reception(columns=RATES_OF_TEXT)
    imu, _ = received(reception, counted_lines(rate, 60.0, busy))
    assert not imu["gap"][1:].any()
    assert reception.imu.rate == pytest.approx(rate, rel=2e-3)
    late = imu["time"] - HOST - np.arange(len(imu)) / rate
    assert np.abs(late[len(imu) // 2 :]).max() < 0.1
    assert np.diff(imu["time"])[len(imu) // 2 :] == pytest.approx(1 / rate, rel=0.01)


@pytest.mark.parametrize("begin", [2.5, 10.0, 40.0])
def test_a_recording_that_begins_later_changes_the_rate_as_the_stream_did(begin: float) -> None:
    stream = counted_lines(98.5, 60.0, 0.005)
    first = [chunk for chunk in stream if chunk.arrival < HOST + begin]
    reception = Reception(columns=RATES_OF_TEXT)
    received_before = [reception.accept(chunk)[0] for chunk in first]
    assert sum(map(len, received_before)) > 200 * (begin > 2.5)
    goes_on = make_reception(json.loads(json.dumps(reception.header)))
    goes_on.accept(Chunk(first[-1].arrival, b"\n"))  # the lines that follow are whole
    for chunk in stream[len(first) :]:
        assert goes_on.accept(chunk)[0]["time"].tobytes() == reception.accept(chunk)[0]["time"].tobytes()


def test_lost_samples_of_a_counted_stream_are_no_other_rate() -> None:
    stream = counted_lines(100.0, 60.0)
    reception = Reception(columns=RATES_OF_TEXT)
    imu, _ = received(reception, [*stream[:3000], *stream[3060:]])
    assert reception.imu.rate == 100.0
    assert np.flatnonzero(imu["gap"][1:]).size == 1


@pytest.mark.parametrize(
    ("measured", "rate"), [(99.1, 100), (198.4, 200), (833.9, 833), (77.0, 77.0), (0.0, 0.0)]
)
def test_nominal_rates(measured: float, rate: float) -> None:
    assert nominal_rate(measured) == rate


def test_missing_samples_are_counted_and_marked() -> None:
    sent = motion(1500)
    there = np.ones(1500, bool)
    there[[400, 700, 701, 702]] = False
    reception = Reception("vectornav")
    imu, _ = received(reception, chunks("vectornav", sent[there]))
    assert reception.loss.missing == 4
    assert np.flatnonzero(imu["gap"]).tolist() == [0, 400, 699]


@pytest.mark.parametrize("device", ["vectornav", "mip"])
def test_what_was_damaged_is_missing_and_no_more(device: str) -> None:
    sent = motion(3000)
    rng = np.random.default_rng(4)
    stream = [Chunk(one.arrival, damaged(one.data, 1e-3, rng)[0]) for one in chunks(device, sent)]
    reception = Reception(device)
    imu, _ = received(reception, stream)
    place = np.rint((imu["time"] - imu["time"][0]) * 100).astype(int)
    assert np.abs((imu["time"] - imu["time"][0]) * 100 - place).max() < 0.2
    assert reception.loss.missing == place[-1] + 1 - len(imu)
    assert np.abs(imu["rate"] - sent["rate"][place]).max() < 1e-3


def test_a_clock_that_began_anew_goes_on_after_a_gap() -> None:
    first, second = motion(500), motion(500)
    stream = chunks("vectornav", first) + [
        Chunk(one.arrival + 8.0, one.data) for one in chunks("vectornav", second)
    ]
    reception = Reception("vectornav")
    imu, _ = received(reception, stream)
    assert len(imu) >= 990
    assert (np.diff(imu["time"]) > 0).all()
    at = int(np.argmax(np.diff(imu["time"]))) + 1
    assert imu["gap"][at]
    assert abs(imu["time"][at] - imu["time"][at - 1] - 3.0) < 0.1


def test_repeated_samples_are_dropped_and_counted() -> None:
    sent = motion(500)
    stream = [one for one in chunks("vectornav", sent) for _ in range(2)]
    reception = Reception("vectornav")
    imu, _ = received(reception, stream)
    assert len(imu) == 500
    assert reception.loss.repeated == 500


def test_the_clock_of_memsense_has_turned_in_a_silence() -> None:
    sent = motion(1000)
    there = np.ones(1000, bool)
    there[400:600] = False  # 2 s, in which its clock starts again 14 times
    reception = Reception("memsense")
    imu, _ = received(reception, chunks("memsense", sent[there]))
    error = imu["time"] - (HOST + sent["time"][there][-len(imu) :] - 7.0)
    assert np.abs(np.diff(error)).max() < 5e-3
    assert imu["gap"][400]


def test_the_axes_may_change_while_it_streams() -> None:
    sent = motion(400)
    stream = chunks("vectornav", sent)
    reception = Reception("vectornav")
    before = [reception.accept(chunk)[0] for chunk in stream[:200]]
    reception.rows.axes = AxisMap.of("y,x,-z")
    after = [reception.accept(chunk)[0] for chunk in stream[200:]]
    imu = np.concatenate(before + after)
    assert np.allclose(imu["force"][:200], sent["force"][:200], atol=1e-3)
    assert np.allclose(imu["force"][200:, 0], sent["force"][200:, 1], atol=1e-3)
    assert np.allclose(imu["force"][200:, 2], -sent["force"][200:, 2], atol=1e-3)


class Told:
    """A decoder that finds the rows it was told, one part for each feed."""

    name = "told"
    wrap_period = math.inf

    def __init__(self, parts: list[np.ndarray]) -> None:
        self.statistics = Statistics()
        self._parts = iter(parts)

    def feed(self, data: bytes) -> Samples:
        """Return the next rows."""
        return Samples(next(self._parts), np.empty(0, FIX))

    def finish(self) -> Samples:
        """Return nothing."""
        return Samples(np.empty(0, IMU), np.empty(0, FIX))


ROW = st.tuples(
    st.one_of(st.just(math.nan), st.floats(-1e12, 1e12), st.integers(0, 50).map(lambda k: k / 10)),
    st.integers(-1, 5),
    st.sampled_from(("both", "rate", "force")),
)


@example([(0.0, [(-1e-112, 0, "both"), (0.0, 0, "both")])], 0.0)  # the host cannot tell them apart
@example([(0.0, [(math.nan, 0, "both")] * 6)], 100.0)  # the clock is useless before a sample has come
@given(
    st.lists(st.tuples(st.floats(0, 3), st.lists(ROW, min_size=1, max_size=20)), min_size=1, max_size=30),
    st.sampled_from((0.0, 100.0)),
)
def test_whatever_the_times_are_those_of_the_host_increase(
    parts: list[tuple[float, list[tuple[float, int, str]]]], rate: float
) -> None:
    tables = []
    for _, rows in parts:
        table = np.zeros(len(rows), IMU)
        table["time"] = [row[0] for row in rows]
        table["count"] = [row[1] for row in rows]
        for k, (_, _, triads) in enumerate(rows):
            if triads != "both":
                table["force" if triads == "rate" else "rate"][k] = np.nan
        tables.append(table)
    reception = Reception("text", rate=rate)
    reception.detector.decoder = Told(tables)
    arrival, found = HOST, []
    for wait, _ in parts:
        arrival += wait
        found.append(reception.accept(Chunk(arrival, b"x"))[0])
    imu = np.concatenate(found)
    assert np.isfinite(imu["time"]).all()
    assert (np.diff(imu["time"]) > 0).all()
    assert len(imu) <= sum(map(len, tables))


def test_a_counter_that_stands_still_is_none() -> None:
    sent = motion(500)
    sent["time"], sent["count"] = np.nan, 7
    reception = Reception("text")
    reception.detector.decoder = Told([row[None] for row in sent])
    imu = np.concatenate([reception.accept(Chunk(HOST + 0.01 * k, b"x"))[0] for k in range(len(sent))])
    assert reception.imu.timing == "by the number of samples at 100 Hz, measured"
    assert len(imu) == len(sent)


def test_noise_says_that_nothing_is_recognised() -> None:
    rng = np.random.default_rng(3)
    reception = Reception()
    for k in range(200):
        imu, fix = reception.accept(Chunk(HOST + 0.05 * k, rng.bytes(1000)))
        assert not len(imu) + len(fix)
    assert "Nothing is recognised" in reception.detector.evidence
    assert reception.detector.statistics.bytes == 200_000


def test_a_protocol_is_found_after_noise() -> None:
    rng = np.random.default_rng(3)
    noise = [Chunk(HOST - 20 + 0.05 * k, rng.bytes(1000)) for k in range(400)]
    reception = Reception()
    imu, _ = received(reception, noise + chunks("vectornav", motion(1500)))
    assert reception.detector.protocol == "vectornav"
    assert len(imu) > 1000


def test_single_triads_of_a_real_receiver_become_samples() -> None:
    """ESF-MEAS of a NEO-M8U: rates and forces come one by one."""
    data = capture("ubx_gpsd_neo-m8u.log")
    step = 400
    reception = Reception("ublox")
    parts = [
        reception.accept(Chunk(HOST + 0.02 * k, data[k * step : (k + 1) * step]))
        for k in range(len(data) // step)
    ]
    imu = np.concatenate([one for one, _ in parts])
    assert np.isfinite(imu["rate"]).all()
    assert np.isfinite(imu["force"]).all()
    assert np.abs(np.linalg.norm(imu["force"], axis=1) - 9.8).max() < 3


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_pieces_do_not_matter_to_the_values(size: int) -> None:
    data = b"".join(one.data for one in chunks("vectornav", motion(300), fixes(3)))
    reception = Reception("vectornav")
    parts = [
        reception.accept(Chunk(HOST + begin * 1e-4, data[begin : begin + size]))
        for begin in range(0, len(data), size)
    ]
    imu = np.concatenate([one for one, _ in parts])
    assert len(imu) == 300
    assert np.abs(imu["rate"] - motion(300)["rate"]).max() < 1e-6


@pytest.mark.proof
@pytest.mark.parametrize("device", ["vectornav", "mip"])
@pytest.mark.parametrize("step", [5.0, -5.0, 4000.0])
@pytest.mark.parametrize("many", [1, 10])
def test_a_device_clock_that_was_set_is_a_jump_and_no_loss(device: str, step: float, many: int) -> None:
    sent = motion(2000)
    stream = chunks(device, sent[:1000], many=many)
    set_to = sent[1000:].copy()
    set_to["time"] += step
    stream += [Chunk(one.arrival - step, one.data) for one in chunks(device, set_to, many=many)]
    reception = Reception(device)
    imu, _ = received(reception, stream)
    assert (reception.loss.missing, reception.loss.jumps) == (0, 1)
    assert np.diff(imu["time"]).max() < 0.1  # no silence where none was
    assert reception.loss.backwards + len(imu) >= 1999


LOST = {
    "every second": np.arange(3000) % 2 == 0,
    "two of three": np.arange(3000) % 3 == 0,
    "every third": np.arange(3000) % 3 != 0,
    "half by chance": np.random.default_rng(4).random(3000) < 0.5,
    "one in ten by chance": np.random.default_rng(5).random(3000) < 0.9,
}
"""Which samples arrive."""


@pytest.mark.parametrize(
    "words",
    [
        "every second",
        "half by chance",
        *(
            pytest.param(words, marks=pytest.mark.proof)
            for words in ("two of three", "every third", "one in ten by chance")
        ),
    ],
)
@pytest.mark.parametrize(("device", "rate"), [("xsens", 0.0), ("mip", 100.0), ("text", 100.0), ("mip", 0.0)])
def test_regular_losses_are_counted(device: str, rate: float, words: str) -> None:
    """A counter or a rate that a person says shows all of them, the clock those that leave single steps."""
    sent = motion(3000)
    encoder = ENCODERS[device]()
    stream = [
        Chunk(HOST + row["time"][0] - 7.0, encoder.encode(row, np.empty(0, FIX)))
        for row in np.split(sent, len(sent))
    ]
    reception = Reception(device, rate=rate)
    received(reception, [chunk for chunk, comes in zip(stream, LOST[words], strict=True) if comes])
    lost = int((~LOST[words]).sum())
    if device == "mip" and not rate:
        lost = 0 if words in ("every second", "two of three") else lost
        # The first half second decides what the usual step is.
        assert lost - 100 <= reception.loss.missing <= lost
    else:
        assert lost - 6 <= reception.loss.missing <= lost


def test_stamps_that_jitter_are_no_multiples_of_the_shortest() -> None:
    rng = np.random.default_rng(6)
    for steps in (rng.integers(6, 10, 128), rng.integers(2, 4, 128), 10 + rng.standard_normal(128)):
        assert math.isnan(common_step(1e-3 * steps))
    assert common_step(1e-2 * rng.integers(1, 4, 128)) == pytest.approx(1e-2)


def test_lost_samples_are_missing_and_no_jump() -> None:
    sent = motion(2000)
    reception = Reception("vectornav")
    received(reception, chunks("vectornav", np.delete(sent, slice(1000, 1500))))
    assert (reception.loss.missing, reception.loss.jumps) == (500, 0)
