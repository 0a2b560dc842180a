"""Logs of autopilots that hold what their filters say of themselves, byte by byte as published."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import numpy as np
from writers import ardupilot

FIELDS = ("gps_hvel", "gps_vvel", "gps_hpos", "gps_vpos", "baro_vpos", "heading", "mag_field")
SIZES = {"gps_hvel": 2, "gps_hpos": 2, "mag_field": 3}
_INNOVATIONS = "uint64_t timestamp;uint64_t timestamp_sample;" + "".join(
    f"float[{SIZES[name]}] {name};" if name in SIZES else f"float {name};" for name in FIELDS
)
FORMATS = {
    "estimator_innovations": _INNOVATIONS,
    "estimator_innovation_variances": _INNOVATIONS,
    "estimator_innovation_test_ratios": _INNOVATIONS,
    "estimator_status": "uint64_t timestamp;uint64_t timestamp_sample;uint64_t control_mode_flags;"
    "uint32_t filter_fault_flags;uint16_t innovation_check_flags;uint8_t reset_count_vel_ne;"
    "uint8_t reset_count_vel_d;uint8_t reset_count_pos_ne;uint8_t reset_count_pod_d;uint8_t "
    "reset_count_quat;",
    "estimator_selector_status": "uint64_t timestamp;uint8_t primary_instance;",
    "ekf2_innovations": "uint64_t timestamp;float[6] vel_pos_innov;float[6] vel_pos_innov_var;float "
    "heading_innov;float heading_innov_var;",
}
FUSED = sum(1 << bit for bit in (2, 4, 9))
"""GPS, heading of the magnetometer, height of the barometer."""


def ulog(messages: Mapping[tuple[str, int], Sequence[tuple[float, bytes]]]) -> bytes:
    """Return a ULog.

    Parameters
    ----------
    messages
        By topic and instance: time [s] and content after the time stamp.
    """
    parts = [b"ULog\x01\x12\x35\x01" + bytes(8), _message("B", bytes(40))]
    parts += [_message("F", f"{name}:{fields}".encode()) for name, fields in FORMATS.items()]
    data = []
    for number, ((name, instance), rows) in enumerate(messages.items()):
        parts.append(_message("A", struct.pack("<BH", instance, number) + name.encode()))
        data += [(at, struct.pack("<HQ", number, round(1e6 * at)) + content) for at, content in rows]
    data.sort(key=lambda one: one[0])
    return b"".join(parts) + b"".join(_message("D", content) for _, content in data)


def _message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def px4(
    time: np.ndarray,
    innovations: np.ndarray,
    variances: np.ndarray,
    *,
    gate: float = 5.0,
    fused: int = FUSED,
    lanes: int = 1,
    primary: np.ndarray | None = None,
    resets: Mapping[str, float] | None = None,
    faults: np.ndarray | None = None,
) -> bytes:
    """Return a log of EKF2.

    Parameters
    ----------
    time : (n,) array
        [s].
    innovations, variances : (n, 11) arrays
        Of `FIELDS`.
    gate
        Of all test ratios, in σ.
    fused
        Bits of ``control_mode_flags``.
    lanes
        Number of instances, which all say the same.
    primary : (n,) array
        The instance that is used.
    resets
        When a counter counts on, by its name [s].
    faults : (n,) array
        ``filter_fault_flags``.
    """
    resets, faults = resets or {}, np.zeros(len(time), int) if faults is None else faults
    ratios = innovations**2 / (gate**2 * variances)
    counters = ("reset_count_vel_ne", "reset_count_vel_d", "reset_count_pos_ne", "reset_count_pod_d",
                "reset_count_quat")  # fmt: skip
    messages: dict[tuple[str, int], list[tuple[float, bytes]]] = {}
    for lane in range(lanes):
        for name, values in zip(FORMATS, (innovations, variances, ratios), strict=False):
            messages[name, lane] = [
                (at, struct.pack("<Q11f", round(1e6 * at), *row))
                for at, row in zip(time, values, strict=True)
            ]
        messages["estimator_status", lane] = [
            (at, struct.pack("<QQIH5B", round(1e6 * at), fused, fault, 0,
                             *(1 + (at >= resets.get(name, np.inf)) for name in counters)))
            for at, fault in zip(time, faults.tolist(), strict=True)
        ]  # fmt: skip
    if primary is not None:
        messages["estimator_selector_status", 0] = [
            (at, struct.pack("<B", one)) for at, one in zip(time, primary.tolist(), strict=True)
        ]
    return ulog(messages)


def px4_old(time: np.ndarray, innovations: np.ndarray, variances: np.ndarray) -> bytes:
    """Return a log of 2018: velocity and position innovations (n, 6), and the heading's."""
    rows = [
        (at, struct.pack("<14f", *nu, *variance, 0.01 * nu[0], 1e-4))
        for at, nu, variance in zip(time, innovations, variances, strict=True)
    ]
    return ulog({("ekf2_innovations", 0): rows})


EKF3 = {
    "XKF3": (80, "QBcccccchhhccff", "TimeUS,C,IVN,IVE,IVD,IPN,IPE,IPD,IMX,IMY,IMZ,IYAW,IVT,RErr,ErSc"),
    "XKF4": (81, "QBccccccffHBIHb", "TimeUS,C,SV,SP,SH,SM,SVT,errRP,OFN,OFE,FS,TS,SS,GPS,PI"),
}


def ekf3(
    time: np.ndarray,
    innovations: np.ndarray,
    variances: np.ndarray,
    *,
    gate: float = 5.0,
    primary: np.ndarray | None = None,
    north: np.ndarray | None = None,
    faults: np.ndarray | None = None,
    said: Sequence[tuple[float, str]] = (),
) -> bytes:
    """Return a log of two cores of EKF3 that say the same.

    Parameters
    ----------
    time : (n,) array
        [s].
    innovations, variances : (n, 6) arrays
        Velocity and position, north, east, down.
    gate
        Of velocity, position and height, in σ.
    primary, north, faults : (n,) arrays
        PI, OFN [m] and FS.
    said
        When, and what the autopilot reported.
    """
    zero = np.zeros(len(time), int)
    primary, faults = (zero if one is None else one for one in (primary, faults))
    north = zero.astype(float) if north is None else north
    formats = {name: ardupilot.FORMATS[name] for name in ("FMT", "PARM", "MSG")} | EKF3
    packers = {
        name: struct.Struct("<3B" + "".join(ardupilot.CODES[letter] for letter in letters))
        for name, (_, letters, _) in formats.items()
    }

    def message(name: str, *values: object) -> bytes:
        return packers[name].pack(0xA3, 0x95, formats[name][0], *values)

    parts = [
        message("FMT", number, packers[name].size, name.encode(), letters.encode(), columns.encode())
        for name, (number, letters, columns) in formats.items()
    ]
    parts += [
        message("PARM", 0, f"EK3_{name}_I_GATE".encode(), 100 * gate, 500.0) for name in ("VEL", "POS", "HGT")
    ]
    parts += [message("MSG", round(1e6 * at), text.encode()) for at, text in said]
    centi = np.rint(100 * innovations).astype(int)
    groups = (slice(0, 3), slice(3, 5), slice(5, 6))
    ratio = [np.sum(innovations[:, own] ** 2, 1) / (gate**2 * np.sum(variances[:, own], 1)) for own in groups]
    roots = np.rint(100 * np.sqrt(np.column_stack(ratio))).astype(int)
    for row, at in enumerate(time):
        for core in range(2):
            stamp = round(1e6 * at)
            parts.append(message("XKF3", stamp, core, *centi[row].tolist(), 0, 0, 0, 0, 0, 0.0, 0.0))
            parts.append(
                message("XKF4", stamp, core, *roots[row].tolist(), 0, 0, 0, north[row], 0.0, int(faults[row]),
                        16, 0, 0, int(primary[row]))
            )  # fmt: skip
    return b"".join(parts)
