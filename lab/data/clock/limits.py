"""Clock limits: from when on a clock, or a sample, is what its time stamps do not show; all in one place."""

from __future__ import annotations

from dataclasses import dataclass

from lab.base.parameters.units import DAY


@dataclass(frozen=True)
class ClockLimits:
    """When stamps step, repeat, lack samples, jitter or drift; for files and for streams."""

    # Samples that are missing, repeated, or of another pace.
    missing: float = 1.5
    """Interval, in usual ones, from which a sample is missing before it: halfway between that of none missing
    and that of one."""
    soonest: float = 0.5
    """Interval, in usual ones, below which a clock is not even: as far from the usual one as `missing`."""
    remembered: float = 0.02
    """Part that a new interval has in the usual one of a stream's clock."""
    steps: int = 128
    """Last steps of a clock that are looked at together: of half of them, single ones are seen."""
    looked: int = 32
    """New steps after which these are looked at again: a third of a second at 100 Hz."""
    single: float = 0.1
    """Part of the steps that must be single ones for the others to be multiples of them, and of these others:
    with fewer of either, the usual step is seen by itself, or is not seen at all."""
    beside_step: float = 0.1
    """Largest deviation of a step from a multiple, in steps: by chance, a fifth of all steps is as near."""
    filled: float = 2.5
    """Interval between samples of the IMU, in usual ones, from which it is filled with others."""
    longest_filled: float = 2.0
    """Longest gap of the IMU that is filled [s]: the motion in a longer one is unknown."""
    polled: int = 4
    """Longest run of equal samples that is a sensor polled too often; a longer one is a sensor at rest, or
    stuck."""
    first_intervals: int = 20
    """Intervals of which the first median is taken: a live stream waits for them, 0.2 s at 100 Hz."""
    intervals: int = 512
    """Intervals of which the usual one is the median; a new rate of the device counts after half of them."""
    block: int = 128
    """Intervals after which the median is taken again."""

    # Steps of a clock.
    step: float = 0.25
    """Jump of the device's clock against the host's that says that it was set [s]; and least delay from which
    samples of a counted stream are missing: a busy host is not late by so much for all of `look`."""
    forward: float = 3600.0
    """Largest step of the device's clock that may be a silence [s]; a larger one says that it was set."""
    unknown_step: float = 1e-3
    """Interval that is taken after a change of the clock before a usual one is known [s]: it keeps the
    order."""
    most_odd: int = 5
    """Changes within `within` samples from which the clock is not used any more. A clock that is set, begins
    anew or turns over makes one, one that repeats or runs backwards nearly as many as samples: with 2, 5 or
    15, all tests of both pass."""
    within: int = 20
    """Samples in which changes are counted, and after which a change is reported as one of its own."""
    even: int = 200
    """Even intervals in a row after which a clock is used again: a second of a usual IMU."""
    begins: float = 2.0
    """Largest time that a clock shows which has just begun anew [s]: devices send within it."""
    compared: int = 128
    """Samples with which one is compared whose time is earlier than the last: datagrams hold at most 1,400
    bytes, so this is five of them."""
    gaps: int = 16
    """Gaps into which a late datagram may fall: those of the last second of a bad network."""
    events: int = 100
    """Most events of a clock that are kept."""
    largest: float = 1e12
    """Largest time that is believed [s]: 30 000 years. Damaged floats hold any number."""
    most_set: int = 3
    """Most steps of a clock of a file that was set back: with more, the stamps jitter."""
    turn: float = 0.9
    """Part of its period by which a counter falls back that begins again, and up to which it has counted."""
    rollover: float = 1024 * 7 * DAY
    """Time after which the week number of GPS begins again: it has ten bits [s]."""
    rollovers: int = 3
    """Most of these that a receiver is behind: the third is in 2038."""
    beside: float = 60.0
    """Largest time beside a rollover at which stamps go on [s]."""

    # Stamps that are coarse or jitter.
    repeated: float = 0.01
    """Part of the samples that have the stamp of the one before, from which all are spread: a stamp that
    repeats now and then is a fault of its own."""
    stamps: int = 3
    """Fewest different stamps that show how far they are apart."""
    truncated: tuple[float, ...] = (1.0, 0.1, 0.01, 0.001)
    """Steps to which loggers truncate time [s]."""
    like: float = 0.25
    """Largest deviation of the usual interval between stamps from such a step, in steps."""
    rounded: float = 1e-3
    """Largest distance of a stamp from a multiple of the step, in steps: doubles of Unix time hold 0.2 µs."""
    regular: float = 0.8
    """Part of the steps between rows in order of time that lie between `soonest` and `missing`. Of two
    recordings that lie over each other some steps are shorter and some are zero."""
    averaged: int = 50
    """Rows before and after a stamp that jitters, with which it is averaged."""

    # The clock of a device against that of the host.
    look: float = 1.0
    """Time over which the least delay is taken [s]: long against a busy host, short against the drift."""
    slowest: float = 0.1
    """Bandwidth of the loop when it has settled [rad/s]: the drift of a crystal changes within minutes."""
    fastest: float = 0.7
    """Bandwidth at the start [rad/s]: below one over `look`, beyond which the loop swings."""
    drift: float = 5e-3
    """Largest drift that is followed: a NEO-M8U ran 0.3 % slow, crystals 0.01 %."""
    slew: float = 5e-3
    """Largest change of the pace beside the drift, which a gyro shows as a scale factor of 0.5 %."""
    fewest_delays: int = 5
    """Fewest least delays with a σ of the drift: fewer are mostly those with which the mapping began."""
    narrowed: float = 3.0
    """σ of the drift in that of a loop with a constant band: this one's narrows. Measured on simulated delays
    of a quiet and a busy host and of a network: 95 % of the errors were within 1.7 σ."""
    made_up: float = 4e-3
    """Change of the pace that makes up for a late beginning: with a crystal's drift, it is below `slew`."""
    latency: float = 0.1
    """How much earlier than they arrive fixes and readings are taken to be valid, if their device has not the
    clock of the IMU [s]: receivers compute and send for 0.05 to 0.2 s. The navigator's latency is beside
    this."""
    stale: float = 5.0
    """Largest difference between the times of a fix or a reading and of a sample by the same clock [s]."""

    # The clock of an IMU against that of its receiver.
    ratio: float = 0.03
    """Largest difference of the rates that is searched: cheap IMUs keep their rate to 1 to 3 %."""
    offset: float = 2.0
    """Largest offset at the first turn that is searched [s]; logs with more are refused."""
    offset_step: float = 0.2
    """Steps of the search [s]: turns last for seconds."""
    begin: float = 240.0
    """Time over which both are searched first [s]: at 1 %, the offset grows by 2.4 s."""
    legs: int = 30
    """Fewest legs with a course; three parameters of the gyros, offset and rate are found from them."""
    speed: float = 3.0
    """Speed from which a course is known [m/s]."""
    leg: float = 3.0
    """Longest time between fixes [s]."""
    likeness: float = 0.9
    """Part of the variance of the turns that the gyros must explain."""
    explained: float = 0.25
    """Part of what a constant offset leaves unexplained that the rate must explain."""
    sigmas: float = 6.0
    """Rate from which it is said, in its σ."""
    correlated: float = 2.0
    """Factor on the variance of residuals, which are correlated from leg to leg."""
    least: float = 5e-4
    """Smallest difference of the rates that is said: crystals keep 0.01 %."""
    apart: float = 0.15
    """Smallest growth of the offset over the log that is said [s]."""


LIMITS = ClockLimits()
"""The limits in use."""
