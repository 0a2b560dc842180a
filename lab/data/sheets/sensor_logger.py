"""Sensor Logger: the signs of the accelerations in exports of the app of that name.

On an iPhone, it writes accelerations and gravity along gravity, as Core Motion does: minus the specific
force, unless its setting *Standardise Units & Frames* is on. ``Metadata.csv`` says both. Where that file is
missing, uncalibrated accelerations in g say it, which are m/s² on Android and with the setting (K. T. H.
Choi, *Awesome Sensor Logger*: CROSSPLATFORM.md, UNITS.md).
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.data.sheets.column_names import GIVEN
from lab.data.sheets.sheet import Sheet

METADATA = "Metadata.csv"
"""Name of the file with the platform."""

_MAX_METADATA = 2**16
"""Most bytes of that file that are read: two lines."""
_TABLES = ("Accelerometer", "AccelerometerUncalibrated", "Gravity", "TotalAcceleration")
"""Files with accelerations of the phone; those of a watch or headphones are not used beside them."""
_ELAPSED = "seconds_elapsed"
"""Heading that the tables have beside `time`."""
_IN_G = (0.6, 1.6)
"""Median length of a specific force in g: of a vehicle, a walker or a hand it is near 1."""
_PLATFORMS = {"ios", "ipados"}
"""What an Apple device is called in that file."""


def read_metadata(text: bytes) -> dict[str, str]:
    """Return what a file `METADATA` says, by heading; nothing for another file of that name."""
    try:
        rows = list(csv.reader(text.decode("utf-8", "replace").splitlines()[:2]))
    except csv.Error:
        return {}
    said = dict(zip(*rows, strict=False)) if len(rows) == 2 else {}
    return said if {"platform", "standardisation"} <= set(said) else {}


def metadata_beside(path: Path) -> dict[str, str]:
    """Return what the file `METADATA` in the folder of a table says; nothing where there is none."""
    beside = path.with_name(METADATA)
    try:
        with beside.open("rb") as file:
            return read_metadata(file.read(_MAX_METADATA))
    except OSError:
        return {}


def against_gravity(sheets: Sequence[Sheet], metadata: dict[str, str]) -> list[Sheet]:
    """Return the tables of an export with accelerations and gravity as specific force, with a report.

    Parameters
    ----------
    sheets
        All tables of a log; those of other programs are not changed.
    metadata
        As of `read_metadata`.
    """
    ours = {
        one.name: one
        for one in sheets
        if one.name.removesuffix(".csv") in _TABLES and any(text.text == _ELAPSED for text in one.headings)
    }
    if not ours:
        return list(sheets)
    why = _why_along_gravity(ours, metadata)
    known = bool(why or metadata)
    return [
        replace(_reverse_force(sheet, why) if why else sheet, signed=known) if sheet.name in ours else sheet
        for sheet in sheets
    ]


def _why_along_gravity(ours: dict[str, Sheet], metadata: dict[str, str]) -> str:
    """Return why the accelerations are along gravity; empty if they are not, or nothing says so."""
    if metadata:
        apple = metadata["platform"].strip().lower() in _PLATFORMS
        same = metadata["standardisation"].strip().lower() == "true"
        return f"{METADATA} names an iPhone without standardised frames" if apple and not same else ""
    raw = ours.get("AccelerometerUncalibrated.csv")
    if raw is None:
        return ""
    size = np.sqrt(sum(values**2 for _, values in raw.all_of("force")) + np.zeros(len(raw)))
    known = size[np.isfinite(size)]
    in_g = bool(known.size) and _IN_G[0] < np.median(known) < _IN_G[1]
    return f"{raw.name} is in g, as on an iPhone" if in_g else ""


def _reverse_force(sheet: Sheet, why: str) -> Sheet:
    headings = tuple(
        replace(one, sign=-one.sign) if one.quantity in {"force", "gravity"} and one.sensor != GIVEN else one
        for one in sheet.headings
    )
    remark = f"The signs of {sheet.name} are reversed: {why}, where Sensor Logger writes them along gravity."
    return replace(sheet, headings=headings, remarks=(*sheet.remarks, remark))
