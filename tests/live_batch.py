"""The live navigator beside the batch: settings for both, pieces in which data arrive, and the comparison."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.clock.timed_samples import TIMED_FIX
from lab.data.protocols.catalogue import ENCODERS
from lab.data.streams.raw_recording import RawWriter
from lab.data.streams.ring import Cursor
from lab.data.streams.source import Source
from lab.data.streams.transport import Chunk
from lab.live.live_navigator import LiveNavigator
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.motion.frames.displacement import metres_per_radian
from lab.navigation.log_navigation import RecordedRun
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

NO_FIXES = np.empty(0, TIMED_FIX)
TOLERANCE = 1e-9
"""Largest difference of live and batch: metres, metres per second, radians, and the same relative to P."""


def suite() -> SensorSuite:
    """Return sensors with biases as those of `live_rows.driven`, and scale factors for 21 states."""
    sensors = SensorSuite()
    sensors.gyro.scale_factor_sigma = sensors.accelerometer.scale_factor_sigma = 0.1
    sensors.gyro.bias_sigma = (0.3,) * 3
    sensors.accelerometer.bias_sigma = (5.0,) * 3
    return sensors


def navigator(kept: float = 1e6, sensors: SensorSuite | None = None, **settings) -> LiveNavigator:
    """Return a live navigator in a car that keeps all samples."""
    return LiveNavigator(sensors or suite(), NavigatorSettings(**{"vehicle": "car"} | settings), kept=kept)


def follow(live: LiveNavigator, source: Source) -> None:
    """Feed a navigator from a source until it ends."""
    cursor = Cursor()
    while True:
        ended = source.ended  # before the last samples are taken
        read = source.since(cursor)
        cursor, live.losses = read.cursor, source.losses
        assert not read.lost
        live.feed(read.imu, read.fix, read.reading)
        if ended and not read.imu.size and not read.fix.size:
            live.finish()
            return
        source.wait(cursor, 0.1)


class LiveSolution(NamedTuple):
    """The solution at all samples that are kept, including what later data said about them.

    Times count from the first sample of the stream [s]; fixes are those since the start of the filter; the
    other arrays are those of `lab.navigation.solution.Solution`.
    """

    time: FloatArray
    position: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    bias: FloatArray
    variance: FloatArray
    covariance: FloatArray
    fix_time: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    fix_rejected: NDArray[np.bool_]


def solution_of(live: LiveNavigator) -> LiveSolution:
    """Return the solution at the samples that a navigator keeps, from the start of the filter on."""
    stream = live._stream
    samples, fixes = stream.samples, stream.fixes
    first, fix = samples.first, max(stream.first_fix, fixes.first)
    last = fix
    if stream.filter is not None:
        first, last = max(stream.filter.first, first), max(fix, stream.filter.next_fix)
    of_fixes = ("time", "innovation", "innovation_covariance", "rejected")
    return LiveSolution(
        *(samples.rows(name, first, stream.end).copy() for name in LiveSolution._fields[:7]),
        *(fixes.rows(name, fix, last).copy() for name in of_fixes),
    )


def random_pieces(seed: int, longest: int = 150) -> Iterator[int]:
    """Yield numbers of samples that arrive together."""
    rng = np.random.default_rng(seed)
    while True:
        yield int(rng.integers(1, longest))


def assert_equal(live: LiveNavigator, run: RecordedRun, cut: float = 0.0) -> None:
    """Compare with a batch run, to `TOLERANCE`; `cut` is the time before its log [s]."""
    mine, batch = solution_of(live), run.solution
    np.testing.assert_allclose(mine.time - cut, run.imu.time, rtol=0, atol=TOLERANCE)
    scale = [*map(float, metres_per_radian(batch.position[0, 0], 0.0)), 1.0]
    assert np.abs((mine.position - batch.position) * scale).max() < TOLERANCE
    for name in ("velocity_n", "q_nb", "bias"):
        assert np.abs(getattr(mine, name) - getattr(batch, name)).max() < TOLERANCE, name
    np.testing.assert_allclose(mine.variance, batch.variance, rtol=TOLERANCE, atol=0)
    assert np.abs(mine.covariance - batch.covariance).max() < TOLERANCE
    np.testing.assert_allclose(mine.fix_time - cut, run.fixes.time, atol=TOLERANCE)
    known = np.isfinite(batch.innovation)
    assert np.abs(mine.innovation - batch.innovation)[known].max() < TOLERANCE
    largest = batch.innovation_covariance.max(axis=(1, 2), keepdims=True)
    differ = np.abs(mine.innovation_covariance - batch.innovation_covariance) / largest
    assert differ.max() < TOLERANCE
    np.testing.assert_array_equal(mine.fix_rejected, batch.fix_rejected)


def recorded(
    path: Path, card_name: str = "", *, damage: float = 0.0, unplugged: float = 0.0, seed: int = 3
) -> Path:
    """Record a flight that a VectorNav sends, with damaged bytes and a plug that is pulled at 40 s [s]."""
    flight = SimulatedFlight.of("montreal", 100.0, sensor=card_name, seed=seed, rest=15.0)
    encoder, writer = ENCODERS["vectornav"](), RawWriter(path, {"protocol": "vectornav"})
    rng, sent = np.random.default_rng(seed), 0
    for end in range(10, 8000, 10):
        rows = flight.imu[end - 10 : end]
        now = float(rows["time"][-1])
        due = int(np.searchsorted(flight.fix["time"], now - 0.15))
        data = encoder.encode(rows, flight.fix[:0])
        data += encoder.encode(rows[:0], flight.fix[sent:due]) if due > sent else b""
        sent = due
        if 40.0 < now < 40.0 + unplugged:
            continue
        hit = np.flatnonzero(rng.random(len(data)) < damage)
        changed = bytearray(data)
        for at in hit.tolist():
            changed[at] ^= int(rng.integers(1, 256))
        writer.accept(Chunk(5000.0 + now + float(rng.exponential(2e-3)), bytes(changed)))
    writer.close()
    return path
