"""ArduPilot's estimator: the innovations, test ratios, faults, resets and lanes of EKF2 and EKF3.

XKF3 (of EKF2: NKF3) has the innovations, state minus measurement, and XKF4 the roots of the test ratios: the
sum of ν² over gate² times the sum of the variances, of velocity, position and height. The gates are the
parameters EK3_VEL_I_GATE, EK3_POS_I_GATE, EK3_HGT_I_GATE and EK3_EAS_I_GATE, in hundredths of σ. The ratio of
the magnetometer is the largest of its axes or of the yaw, so that it bounds the innovations and is not judged
for its size. Each core is a lane.

References
----------
ArduPilot, ``AP_NavEKF3_PosVelFusion.cpp`` (test ratios), ``AP_NavEKF3_Outputs.cpp`` (faults, timeouts),
``AP_NavEKF3/LogStructure.h`` (messages), and the same of ``AP_NavEKF2``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lab.base.files.mission_error import MissionError
from lab.base.numbers import format_number
from lab.data.files.ardupilot import open_log
from lab.data.files.dataflash_file import Log, parameters_of
from lab.data.files.dataflash_time import MessageTimes
from lab.data.files.streams import TIME, Messages
from lab.data.log.filter_log import (
    AXES,
    MAX_LANES,
    Event,
    FilterLog,
    Innovations,
    Lane,
    Measured,
    Track,
    changes,
    in_order,
    innovations_of,
    lane_changes,
    nearest,
    rejections,
    track_of,
    while_set,
)

_OTHERS = ("POS", "MSG", "PARM", "ERR", "XKV1", "GPS")


class _Kind(NamedTuple):
    """One of ArduPilot's filters: its messages and the beginning of its parameters."""

    name: str
    innovations: str
    ratios: str
    states: str
    parameters: str


_KINDS = (
    _Kind("ArduPilot EKF3", "XKF3", "XKF4", "XKF1", "EK3"),
    _Kind("ArduPilot EKF2", "NKF3", "NKF4", "NKF1", "EK2"),
)
_MEASURED = (
    (Measured("GPS velocity", AXES, "m/s"), ("IVN", "IVE", "IVD"), "SV", "VEL", 500.0),
    (Measured("GPS position", AXES[:2], "m"), ("IPN", "IPE"), "SP", "POS", 500.0),
    (Measured("height", AXES[2:], "m"), ("IPD",), "SH", "HGT", 500.0),
    (Measured("airspeed", ("",), "m/s"), ("IVT",), "SVT", "EAS", 400.0),
)
"""Innovations, their test ratio, its gate's parameter, and the gate by default [hundredths of σ]."""
_MAGNETOMETER = (Measured("magnetometer", ("x", "y", "z"), "mG"), ("IMX", "IMY", "IMZ"), "SM")
_LEAST_GATE = 100.0
"""Smallest gate that ArduPilot uses, whatever the parameter says [hundredths of σ]."""
_STEP = 0.01
"""Step in which the roots of the test ratios are logged."""
_SHOWN_ROOT = 5 * _STEP
"""Root of a test ratio from which it tells the variance to a fifth, for its step."""
_FEWEST_SHOWN = 10
"""Fewest innovations whose median variance stands for the others: single ones may be damaged."""
_STARTING = "that it is not initialised"
_FAULTS = (
    *("a quaternion that is no number", "a velocity that is no number"),
    *(f"a badly conditioned fusion of the magnetometer {axis}" for axis in "XYZ"),
    *("a badly conditioned fusion of the airspeed", "a badly conditioned fusion of the sideslip"),
    _STARTING,
)
"""Bits of FS."""
_TIMEOUTS = ("position", "velocity", "height", "magnetometer")
"""Bits of TS; that of the airspeed is set in all vehicles without an airspeed sensor."""
_SUBSYSTEMS = {16: "EKF check", 17: "EKF failsafe", 24: "EKF primary"}
"""Subsystems of ERR that are about the filter (ArduPilot, LogErrorSubsystem)."""
_WORDS = ("EKF", "lane", "GPS Glitch", "yaw reset", "primary")
"""Words of the messages MSG that are about the filter."""
_FIRST_VARIANCES = ("V07", "V08", "V09")
"""Variances of the position in XKV1: states 7 to 9, after four of the quaternion and three of the
velocity."""


def read(path: Path) -> FilterLog:
    """Read what EKF3 or EKF2 says of itself: of the one that flew, if both ran.

    Raises
    ------
    MissionError
        If the file cannot be read, or the log has no innovations with test ratios.
    """
    names = [name for kind in _KINDS for name in (kind.innovations, kind.ratios, kind.states)]
    log, times = open_log(path, (*names, *_OTHERS))
    parameters = parameters_of(log)
    flown = parameters.get("AHRS_EKF_TYPE")
    kinds = sorted(_KINDS, key=lambda kind: f"EK{flown or 3:.0f}" != kind.parameters)
    for kind in kinds:
        innovations, ratios = times.of(kind.innovations), times.of(kind.ratios)
        if innovations is None or ratios is None:
            continue
        lanes = _lanes(kind, times, innovations, ratios, parameters)
        if lanes:
            return _filter_log(path, kind, log, times, lanes, ratios)
    raise MissionError(
        f"{path}: the log has no innovations with test ratios (XKF3 and XKF4, or NKF3 and NKF4); it has "
        f"{', '.join(log.names) or 'none of the messages of an estimator'}. Accepted are logs with them: set "
        "LOG_BITMASK to log the attitude and the navigation"
    )


def _filter_log(
    path: Path, kind: _Kind, log: Log, times: MessageTimes, lanes: list[Lane], ratios: Messages
) -> FilterLog:
    cores = [int(lane.name.rsplit(" ", 1)[1]) for lane in lanes]
    primary, events = _read_selected_lane(kind, ratios, cores)
    own = _of_core(ratios, cores[primary])
    events += _resets(kind, own) + _flag_events(kind, own) + _messages(log, times)
    events += [event for one in lanes[primary].innovations for event in rejections(one, kind.name)]
    return FilterLog.of(path, kind.name, lanes, primary, events, _flags(kind, own), float(own[TIME][0]))


def _of_core(messages: Messages, core: float) -> Messages:
    rows = messages["C"] == core if "C" in messages else np.ones(len(messages[TIME]), dtype=bool)
    return {name: values[rows] for name, values in messages.items()}


def _lanes(
    kind: _Kind,
    times: MessageTimes,
    innovations: Messages,
    ratios: Messages,
    parameters: Mapping[str, float],
) -> list[Lane]:
    lanes = []
    for core in np.unique(innovations.get("C", np.zeros(1)))[:MAX_LANES].tolist():
        values, tested = _of_core(innovations, core), _of_core(ratios, core)
        found = _innovations(kind, values, tested, parameters)
        if found:
            lanes.append(Lane(f"core {core:.0f}", tuple(found), _track(kind, times, core)))
    return lanes


def _innovations(
    kind: _Kind, values: Messages, tested: Messages, parameters: Mapping[str, float]
) -> list[Innovations]:
    if not np.isfinite(tested[TIME]).any():
        return []
    time = values[TIME]
    rows = nearest(tested[TIME], time)
    found = []
    for measured, fields, root, gate, usual in _MEASURED:
        if not {*fields} <= set(values) or root not in tested:
            continue
        width = max(parameters.get(f"{kind.parameters}_{gate}_I_GATE", usual), _LEAST_GATE) / 100
        ratio, columns = tested[root][rows] ** 2, np.column_stack([values[one] for one in fields])
        source = f"{kind.innovations}.{fields[0]}, {kind.ratios}.{root}"
        one = innovations_of(measured, time, columns, source, square=ratio * width**2, ratio=ratio)
        found += [] if one is None else [_with_common_variance(one, width)]
    measured, fields, root = _MAGNETOMETER
    if {*fields} <= set(values) and root in tested:
        columns, ratio = np.column_stack([values[one] for one in fields]), tested[root][rows] ** 2
        nothing = np.full(columns.shape, np.nan)
        source = f"{kind.innovations}.{fields[0]}, {kind.ratios}.{root}"
        if columns.any():
            found.append(Innovations(*measured, time, columns, nothing, nothing[:, 0], ratio, source))
    return found


def _with_common_variance(one: Innovations, gate: float) -> Innovations:
    """Return innovations in the usual σ of the log, where the step of the ratio leaves their own unknown."""
    shown = one.square >= (_SHOWN_ROOT * gate) ** 2
    mean = np.mean(one.values**2, axis=1)
    variance = float(np.median(mean[shown] / one.square[shown])) if shown.sum() >= _FEWEST_SHOWN else np.nan
    each = np.where(shown, mean / np.where(shown, one.square, 1.0), variance)[:, None]
    normalised = one.values / np.sqrt(np.where(each > 0, each, np.nan))
    return replace(one, normalised=normalised)


def _track(kind: _Kind, times: MessageTimes, core: float) -> Track | None:
    """Return the position of the primary core, which POS holds, with the σ of a core."""
    position = times.of("POS")
    if position is None or not {"Lat", "Lng", "Alt"} <= set(position):
        return None
    place = np.column_stack((np.radians(position["Lat"]), np.radians(position["Lng"]), position["Alt"]))
    time, sigma = position[TIME], np.full((len(place), 3), np.nan)
    variances = times.of("XKV1") if kind.parameters == "EK3" else None
    source = "POS"
    if variances is not None and set(_FIRST_VARIANCES) <= set(variances):
        own = _of_core(variances, core)
        rows = np.flatnonzero(np.isfinite(own[TIME]))
        rows = rows[in_order(own[TIME][rows])]
        if rows.size > 1:
            with np.errstate(invalid="ignore"):
                columns = [np.sqrt(own[name][rows]) for name in _FIRST_VARIANCES]
            sigma = np.column_stack([np.interp(time, own[TIME][rows], column) for column in columns])
            source = "POS, XKV1.V07"
    return track_of(time, place, sigma, source)


def _read_selected_lane(kind: _Kind, ratios: Messages, cores: list[int]) -> tuple[int, list[Event]]:
    chosen = ratios.get("PI")
    if chosen is None:
        return 0, []
    rows = ratios["C"] == cores[0] if "C" in ratios else slice(None)
    time, chosen = ratios[TIME][rows], chosen[rows]
    events = lane_changes(time, chosen, "core", kind.name, f"{kind.ratios}.PI")
    return int(np.argmax([np.sum(chosen == core) for core in cores])), events


def _resets(kind: _Kind, own: Messages) -> list[Event]:
    if not {"OFN", "OFE"} <= set(own):
        return []
    found = {at for field in ("OFN", "OFE") for at, _, _ in changes(own[TIME], own[field])}
    text, source = f"{kind.name} reset the horizontal position at {{:.1f}} s.", f"{kind.ratios}.OFN, OFE"
    return [Event(at, "reset", text.format(at), source) for at in sorted(found)]


def _flag_events(kind: _Kind, own: Messages) -> list[Event]:
    events = []
    for field, bits, event, said in (
        ("FS", _FAULTS, "fault", "reported {what}"),
        ("TS", _TIMEOUTS, "timeout", "had not used the {what} for too long"),
    ):
        if field not in own:
            continue
        states = np.nan_to_num(own[field]).astype(np.int64)
        for bit, what in enumerate(bits):
            is_set = (states & (1 << bit)) != 0
            if what == _STARTING:  # which it says until it has begun
                is_set &= np.logical_or.accumulate(~is_set)
            text, source = f"{kind.name} {said.format(what=what)}", f"{kind.ratios}.{field} bit {bit}"
            events += while_set(own[TIME], is_set, event, text, source)
    return events


def _messages(log: Log, times: MessageTimes) -> list[Event]:
    """Return what the autopilot reported in words and in numbered errors about its filter."""
    events = []
    said, texts = times.of("MSG"), log.texts("MSG", "Message")
    if said is not None and len(texts) == len(said[TIME]):
        for at, text in zip(said[TIME].tolist(), texts, strict=True):
            if any(word in text for word in _WORDS):
                words = "".join(filter(str.isprintable, text))
                events.append(Event(at, "message", f"The autopilot reported at {at:.1f} s: {words}", "MSG"))
    errors = times.of("ERR")
    if errors is not None and {"Subsys", "ECode"} <= set(errors):
        for at, system, code in zip(errors[TIME], errors["Subsys"], errors["ECode"], strict=True):
            if system in _SUBSYSTEMS and code:
                name = _SUBSYSTEMS[int(system)]
                text = f"The autopilot reported an error of the {name}, code {code:.0f}, at {at:.1f} s."
                events.append(Event(float(at), "fault", text, "ERR"))
    return events


def _flags(kind: _Kind, own: Messages) -> str:
    """Return what the flags say, in a sentence."""
    roots = [(name, own[name]) for name in ("SV", "SP", "SH", "SM", "SVT") if name in own]
    over = [
        f"{name} above 1 {format_number(100 * float(np.mean(root > 1)))} % of the time"
        for name, root in roots
        if (root > 1).any()
    ]
    faults = int(np.sum(np.nan_to_num(own.get("FS", np.zeros(1))) != 0))
    said = ", ".join([*over, *([f"FS set {faults} times"] if faults else [])])
    return f"{kind.ratios}: {said or 'all test ratios below 1, no fault'}."
