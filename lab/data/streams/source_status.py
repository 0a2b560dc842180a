"""Source status: what a source is doing, as a snapshot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lab.data.protocols.decoder import Statistics
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.reception import Loss
from lab.data.streams.ring import Read

OPENING, STREAMING, STALE, LOST, ENDED = "opening", "streaming", "stale", "lost", "ended"
"""States of a source."""
MEASURED = 2.0
"""Time over which rate, jitter and latency are measured [s]."""
LEAST_SAMPLES = 3
"""Fewest samples of which a delay and its spread are reported."""
MEASURED_FIXES = 10.0
"""Time over which the rate of the fixes is measured [s]: most receivers send one a second."""


@dataclass(frozen=True)
class Event:
    """Something that happened to a source.

    Attributes
    ----------
    time : float
        Of the host's monotonic clock [s].
    text : str
        What happened, in a sentence.
    """

    time: float
    text: str


@dataclass(frozen=True)
class Status:
    """The state of a source at a moment.

    Attributes
    ----------
    state : str
        `OPENING`, `STREAMING`, `STALE`, `LOST` or `ENDED`.
    sentence : str
        The state in words, with the reason.
    protocol, evidence, timing : str
        As of `Reception`.
    axes : AxisMap
        The axis map.
    samples, fixes : int
        Samples of the IMU and fixes so far.
    rate, fix_rate : float
        Of the last seconds [Hz].
    jitter : float
        Standard deviation of the intervals between arrivals in the last seconds [s].
    latency : float
        Median delay of the arrivals in the last seconds, beyond the least [s].
    silence : float
        Time since the last bytes [s].
    statistics : Statistics
        What the decoder has seen.
    loss : Loss
        Losses between the device and the filter.
    interruptions : int
        How often the device was lost after it was reached.
    drift, drift_sigma : float
        How much faster the device's clock runs than the host's, as a part of 1, and its σ; NaN without
        samples.
    offset : float
        Host's clock minus the device's [s].
    clock : str
        What last happened to the device's clock, in a sentence; empty if nothing did.
    recording : str
        Path of the raw recording; empty if there is none.
    recorded : int
        Its size [bytes].
    warning : str
        What is about to go wrong with it, or what went wrong.
    events : tuple of Event
        The last events, oldest first.
    doubt : tuple of str
        Units that the angular rates may have, the one that is used first; empty where it is known.
    question : str
        The doubt in a sentence, with how it ends; empty without one.
    reading : mapping of str to str
        Columns by their number that the samples bear out in place of those in use; empty if these are right.
    last_lines : tuple of str
        The last lines of text whose columns are not recognised.
    """

    state: str
    sentence: str
    protocol: str = ""
    evidence: str = ""
    timing: str = ""
    axes: AxisMap = field(default_factory=AxisMap)
    samples: int = 0
    fixes: int = 0
    rate: float = 0.0
    fix_rate: float = 0.0
    jitter: float = float("nan")
    latency: float = float("nan")
    silence: float = 0.0
    statistics: Statistics = field(default_factory=Statistics)
    loss: Loss = field(default_factory=Loss)
    interruptions: int = 0
    drift: float = float("nan")
    drift_sigma: float = float("nan")
    offset: float = float("nan")
    clock: str = ""
    recording: str = ""
    recorded: int = 0
    warning: str = ""
    events: tuple[Event, ...] = ()
    doubt: tuple[str, ...] = ()
    question: str = ""
    reading: Mapping[str, str] = field(default_factory=dict)
    last_lines: tuple[str, ...] = ()


def measure_rates(read: Read, now: float) -> tuple[float, float, float, float]:
    """Return rates of the samples and fixes [Hz], jitter and latency [s] of what was read until now [s]."""
    imu = read.imu[read.imu["arrival"] > now - MEASURED]
    fix = read.fix[read.fix["arrival"] > now - MEASURED_FIXES]
    rate, fix_rate = _rate(imu["time"]), _rate(fix["time"])
    if len(imu) < LEAST_SAMPLES:
        return rate, fix_rate, float("nan"), float("nan")
    delay = imu["arrival"] - imu["time"]
    return rate, fix_rate, float(np.diff(imu["arrival"]).std()), float(np.median(delay) - delay.min())


def _rate(times: Any) -> float:
    return (
        float((len(times) - 1) / (times[-1] - times[0])) if len(times) > 1 and times[-1] > times[0] else 0.0
    )
