"""Source status: what a source is doing, as a snapshot."""

from __future__ import annotations

from dataclasses import dataclass, field

from lab.data.protocols.decoder import Statistics
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.reception import Loss

OPENING, STREAMING, STALE, LOST, ENDED = "opening", "streaming", "stale", "lost", "ended"
"""States of a source."""


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
    last_lines: tuple[str, ...] = ()
