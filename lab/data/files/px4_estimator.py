"""PX4's estimator: the innovations, states, resets and flags of EKF2 in a ULog.

Each instance of the estimator is a lane. Which measurements an instance fused, the bits of
``control_mode_flags`` say; innovations of others are logged too and judge nothing. Until PX4 1.10 the
innovations are in ``ekf2_innovations``, and the log has one instance.

References
----------
PX4 Guide, *uORB Message Reference*: EstimatorInnovations, EstimatorStatus, EstimatorStatusFlags,
EstimatorEventFlags, EstimatorSelectorStatus, VehicleLocalPosition,
https://docs.px4.io/main/en/msg_docs/

PX4, *EKF2*, ``estimator_interface.h``: the test ratio is ν² / (gate² S), rejected above 1.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.base.arrays import Flags, FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.numbers import format_number
from lab.data.files.streams import TIME, Messages
from lab.data.files.ulog import TopicRows, open_ulog
from lab.data.files.ulog_file import ULogFile
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
    innovations_of,
    lane_changes,
    nearest,
    rejections,
    track_of,
    while_set,
)

NAME = "PX4 EKF2"

_INNOVATIONS, _VARIANCES = "estimator_innovations", "estimator_innovation_variances"
_RATIOS, _OLD = "estimator_innovation_test_ratios", "ekf2_innovations"
_STATUS, _FLAGS, _EVENTS = "estimator_status", "estimator_status_flags", "estimator_event_flags"
_SELECTOR, _GLOBAL = "estimator_selector_status", "estimator_global_position"
_ALL_GLOBAL, _LOCAL = "vehicle_global_position", "vehicle_local_position"
_TOPICS = (
    _INNOVATIONS, _VARIANCES, _RATIOS, _OLD, _STATUS, _FLAGS, _EVENTS, _SELECTOR, _GLOBAL, _ALL_GLOBAL,
    _LOCAL,
)  # fmt: skip
_HORIZONTAL, _VERTICAL = AXES[:2], AXES[2:]
"""Axes of level and of vertical measurements."""
_GNSS, _FLOW, _MAG_HEADING, _MAG, _BARO, _RANGE, _GNSS_HEIGHT = 2, 3, 4, 5, 9, 10, 11
"""Bits of ``control_mode_flags`` (EstimatorStatus)."""
_VISION, _VISION_YAW, _VISION_HEIGHT, _AIRSPEED, _GNSS_YAW, _VISION_VELOCITY = 12, 13, 14, 19, 22, 24
"""Further bits of it."""
_YAWS = (_MAG_HEADING, _VISION_YAW, _GNSS_YAW)


_FIELDS = {
    "gps_hvel": (Measured("GPS velocity", _HORIZONTAL, "m/s"), (_GNSS,)),
    "gps_vvel": (Measured("GPS vertical velocity", _VERTICAL, "m/s"), (_GNSS,)),
    "gps_hpos": (Measured("GPS position", _HORIZONTAL, "m"), (_GNSS,)),
    "gps_vpos": (Measured("GPS height", _VERTICAL, "m"), (_GNSS_HEIGHT,)),
    "ev_hvel": (Measured("vision velocity", _HORIZONTAL, "m/s"), (_VISION_VELOCITY,)),
    "ev_vvel": (Measured("vision vertical velocity", _VERTICAL, "m/s"), (_VISION_VELOCITY,)),
    "ev_hpos": (Measured("vision position", _HORIZONTAL, "m"), (_VISION,)),
    "ev_vpos": (Measured("vision height", _VERTICAL, "m"), (_VISION_HEIGHT,)),
    "rng_vpos": (Measured("range finder", _VERTICAL, "m"), (_RANGE,)),
    "baro_vpos": (Measured("barometer", _VERTICAL, "m"), (_BARO,)),
    "flow": (Measured("optical flow", ("x", "y"), "rad/s"), (_FLOW,)),
    "heading": (Measured("heading", ("",), "rad"), _YAWS),
    "mag_field": (Measured("magnetometer", ("x", "y", "z"), "G"), (_MAG,)),
    "airspeed": (Measured("airspeed", ("",), "m/s"), (_AIRSPEED,)),
}
"""Fields of the innovations since PX4 1.11: what each is of, and the bits one of which says that it was
fused."""
_OLD_FIELDS = {
    "vel_pos_innov[0:2]": ("vel_pos_innov", slice(0, 2), _FIELDS["gps_hvel"]),
    "vel_pos_innov[2]": ("vel_pos_innov", slice(2, 3), _FIELDS["gps_vvel"]),
    "vel_pos_innov[3:5]": ("vel_pos_innov", slice(3, 5), _FIELDS["gps_hpos"]),
    "vel_pos_innov[5]": (
        "vel_pos_innov",
        slice(5, 6),
        (Measured("height", _VERTICAL, "m"), (_BARO, _RANGE, _GNSS_HEIGHT, _VISION_HEIGHT)),
    ),
    "mag_innov": ("mag_innov", slice(0, 3), _FIELDS["mag_field"]),
    "heading_innov": ("heading_innov", slice(0, 1), _FIELDS["heading"]),
    "airspeed_innov": ("airspeed_innov", slice(0, 1), _FIELDS["airspeed"]),
}
"""Fields of ``ekf2_innovations``, until PX4 1.10; each has its variances in the field that ends with
``_var``."""
_COUNTERS = (
    ("reset_count_pos_ne", "the horizontal position"),
    ("reset_count_pod_d", "the height"),
    ("reset_count_vel_ne", "the horizontal velocity"),
    ("reset_count_vel_d", "the vertical velocity"),
    ("reset_count_quat", "the attitude"),
)
"""Counters of ``estimator_status`` since 1.13, the second as PX4 spells it, and what was reset."""
_LOCAL_COUNTERS = (
    ("xy_reset_counter", "the horizontal position"),
    ("z_reset_counter", "the height"),
    ("vxy_reset_counter", "the horizontal velocity"),
    ("vz_reset_counter", "the vertical velocity"),
    ("heading_reset_counter", "the heading"),
)
"""Counters of ``vehicle_local_position``, which earlier logs have."""
_OF_ACCELEROMETERS = "fs_bad_acc"
"""Beginning of the flags of the accelerometers' data, which the estimator takes into account."""
_NUMERICAL = (1 << 15) - 1
"""Bits of ``filter_fault_flags`` that are numerical errors; those above are of the accelerometers' data."""


def read(path: Path) -> FilterLog:
    """Read what EKF2 says of itself.

    Raises
    ------
    MissionError
        If the file cannot be read, or the log has no innovations that were fused.
    """
    log = open_ulog(path, _TOPICS)
    numbers = log.instances(_INNOVATIONS)
    lanes = [lane for number in numbers[:MAX_LANES] or [0] if (lane := _lane(log, number)) is not None]
    if not lanes:
        raise MissionError(
            f"{path}: the log has no innovations that EKF2 fused ({_INNOVATIONS} with {_VARIANCES}, or "
            f"{_OLD}); it has {', '.join(log.names) or 'no message of an estimator'}. Accepted are logs "
            "with them: set SDLOG_PROFILE to log the estimator"
        )
    primary, switches = _read_selected_lane(log, [int(lane.name.rsplit(" ", 1)[1]) for lane in lanes])
    number = int(lanes[primary].name.rsplit(" ", 1)[1])
    selected = _track(_topic(log, _ALL_GLOBAL), _ALL_GLOBAL)
    if selected is not None:  # it is logged more often than that of each instance
        lanes[primary] = replace(lanes[primary], track=selected)
    events = [*switches, *_resets(log, number), *_faults(log, number)]
    events += [event for one in lanes[primary].innovations for event in rejections(one, "EKF2")]
    flags, fusing = _flags(log, number), _fusion_fraction(log, number)
    return FilterLog.of(path, NAME, lanes, primary, events, flags, fusing)


def _topic(log: ULogFile, name: str, number: int | None = None) -> Messages | None:
    """Return the messages of one instance of a topic, by default of its lowest."""
    rows = log.topic(name, number)
    return None if rows is None else TopicRows(rows, rows.dtype.names or ())


def _lane(log: ULogFile, number: int) -> Lane | None:
    found = _innovations(log, number) or (_old_innovations(log) if number == 0 else [])
    track = _track(_topic(log, _GLOBAL, number), _GLOBAL)
    return Lane(f"instance {number}", tuple(found), track) if found else None


def _innovations(log: ULogFile, number: int) -> list[Innovations]:
    topics = [_topic(log, name, number) for name in (_INNOVATIONS, _VARIANCES, _RATIOS)]
    innovations, variances, ratios = topics
    if innovations is None or variances is None:
        return []
    time = innovations[TIME]
    rows = nearest(variances[TIME], time)
    tested = None if ratios is None else nearest(ratios[TIME], time)
    found = []
    for name, (measured, bits) in _FIELDS.items():
        values, variance = _field(innovations, name, measured), _field(variances, name, measured)
        if values is None or variance is None:
            continue
        ratio = None if ratios is None or tested is None else _largest_ratio(ratios, name, tested)
        used, source = _fusion_times(log, number, time, bits), f"{_INNOVATIONS}.{name}"
        one = innovations_of(measured, time, values, source, variance=variance[rows], ratio=ratio, used=used)
        found += [] if one is None else [one]
    return found


def _old_innovations(log: ULogFile) -> list[Innovations]:
    topic = _topic(log, _OLD)
    if topic is None:
        return []
    time, found = topic[TIME], []
    for name, (field, own, (measured, bits)) in _OLD_FIELDS.items():
        if not {field, f"{field}_var"} <= set(topic):
            continue
        values, variance = (
            topic[key].reshape(len(topic[TIME]), -1)[:, own] for key in (field, f"{field}_var")
        )
        if values.shape[1] == len(measured.axes) == variance.shape[1]:
            used = _fusion_times(log, 0, time, bits)
            one = innovations_of(measured, time, values, f"{_OLD}.{name}", variance=variance, used=used)
            found += [] if one is None else [one]
    return found


def _field(messages: Messages, name: str, measured: Measured) -> FloatArray | None:
    if name not in messages:
        return None
    values = messages[name].reshape(len(messages[TIME]), -1)
    return values if values.shape[1] == len(measured.axes) else None


def _largest_ratio(ratios: Messages, name: str, rows: np.ndarray) -> FloatArray | None:
    if name not in ratios:
        return None
    values = ratios[name].reshape(len(ratios[TIME]), -1)[rows]
    return np.asarray(np.where(np.isfinite(values), values, -np.inf).max(axis=1))


def _bits(log: ULogFile, number: int) -> tuple[FloatArray, np.ndarray] | None:
    status = _topic(log, _STATUS, number)
    if status is None or "control_mode_flags" not in status:
        return None
    return status[TIME], status["control_mode_flags"].astype(np.uint64)


def _fusion_times(log: ULogFile, number: int, time: FloatArray, bits: tuple[int, ...]) -> Flags | None:
    """Return when a measurement was fused; None if the log does not say so."""
    found = _bits(log, number)
    if found is None or not len(found[0]):
        return None
    mask = np.uint64(sum(1 << bit for bit in bits))
    return np.asarray((found[1][nearest(found[0], time)] & mask) != 0)


def _fusion_fraction(log: ULogFile, number: int) -> float:
    found = _bits(log, number)
    if found is None:
        return -np.inf
    fused = np.flatnonzero(found[1] & np.uint64(1 << _GNSS))
    return float(found[0][fused[0]]) if fused.size else np.inf


def _track(topic: Messages | None, name: str) -> Track | None:
    fields = ("lat", "lon", "alt", "eph", "epv")
    if topic is None or not set(fields) <= set(topic):
        return None
    latitude, longitude, height, level, vertical = (topic[key] for key in fields)
    height = topic.get("alt_ellipsoid", height)
    each = level / np.sqrt(2.0)  # eph is that of both axes together
    place = np.column_stack((np.radians(latitude), np.radians(longitude), height))
    return track_of(
        topic[TIME], place, np.column_stack((each, each, vertical)), f"{name}: lat, lon, alt, eph, epv"
    )


def _read_selected_lane(log: ULogFile, numbers: list[int]) -> tuple[int, list[Event]]:
    """Return the index of the lane that was used most of the time, and the changes from one to another."""
    selector = _topic(log, _SELECTOR)
    if selector is None or "primary_instance" not in selector:
        return 0, []
    time, chosen = selector[TIME], selector["primary_instance"]
    counts = [int(np.sum(chosen == number)) for number in numbers]
    events = lane_changes(time, chosen, "instance", "EKF2", f"{_SELECTOR}.primary_instance")
    return int(np.argmax(counts)), events


def _resets(log: ULogFile, number: int) -> list[Event]:
    for name, counters, topic in (
        (_STATUS, _COUNTERS, _topic(log, _STATUS, number)),
        (_LOCAL, _LOCAL_COUNTERS, _topic(log, _LOCAL)),
    ):
        if topic is None or counters[0][0] not in topic:
            continue
        time = topic[TIME]
        return [
            Event(at, "reset", f"EKF2 reset {what} at {at:.1f} s.", f"{name}.{field}")
            for field, what in counters
            if field in topic
            for at, _, _ in changes(time, topic[field])
        ]
    return []


def _faults(log: ULogFile, number: int) -> list[Event]:
    events = []
    flags = _topic(log, _FLAGS, number)
    names = [] if flags is None else [name for name in flags if name.startswith("fs_")]
    for name in (one for one in names if not one.startswith(_OF_ACCELEROMETERS)):
        assert flags is not None
        events += while_set(flags[TIME], flags[name] != 0, "fault", f"EKF2 reported {name}", _FLAGS)
    status = _topic(log, _STATUS, number)
    if not names and status is not None and "filter_fault_flags" in status:
        is_set = (status["filter_fault_flags"].astype(np.int64) & _NUMERICAL) != 0
        source = f"{_STATUS}.filter_fault_flags"
        events += while_set(status[TIME], is_set, "fault", "EKF2 reported a numerical fault", source)
    if flags is not None and "cs_inertial_dead_reckoning" in flags:
        events += while_set(
            flags[TIME], flags["cs_inertial_dead_reckoning"] != 0, "timeout",
            "EKF2 navigated without any fix (dead reckoning)", f"{_FLAGS}.cs_inertial_dead_reckoning",
        )  # fmt: skip
    return events


def _flags(log: ULogFile, number: int) -> str:
    """Return what the flags say, in a sentence."""
    flags, status = _topic(log, _FLAGS, number), _topic(log, _STATUS, number)
    if flags is not None:
        names = list(flags)
        said = [
            f"{name} {format_number(100 * np.mean(flags[name] != 0))} % of the time"
            for name in names
            if name.startswith(("reject_", "fs_")) and (flags[name] != 0).any()
        ]
        return f"{_FLAGS}: {', '.join(said) or 'nothing rejected, no fault'}."
    if status is not None and "innovation_check_flags" in status:
        checked = status["innovation_check_flags"]
        part = float(np.mean(checked != 0))
        rejected = f"a measurement rejected {format_number(100 * part)} % of the time"
        return f"{_STATUS}.innovation_check_flags: {rejected if part else 'nothing rejected'}."
    return "The log has no flags of the estimator."
