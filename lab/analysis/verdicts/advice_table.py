"""Advice table: the advice of findings that have more than one, and how advice is told after a trial.

Names in braces are fields, as in the table of findings (`finding_table`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lab.analysis.verdicts.finding import WITHHELD, Advice, Change
from lab.base.parameters.toml_file import read_toml

TABLES = read_toml(Path(__file__).with_name("findings.toml"))
"""The tables in ``findings.toml``: of advice, of findings, and of those about a filter that is not ours."""


def read_advice(row: Mapping[str, Any]) -> Advice:
    """Return the advice of a row of a table; empty if it has none."""
    return Advice(row.get("advice", ""), tuple(Change(*one) for one in row.get("changes", ())))


ADVICE = {name: read_advice(row) for name, row in TABLES["advice"].items()}
"""Advice of findings that have more than one, by name."""
KEEP_R = ADVICE["use fewer fixes"].text.partition(":")[0] + ":"
"""Beginning of the advice on fixes of a receiver that filters them."""

TRIED: dict[str, str] = {
    "better": "{advice} Tried: {effect}.",
    "better together": "{advice} Tried, all advice together: {effect}.",
    "with less trust": "{advice} Tried, with less trust in them: {effect}.",
    "refused": "{advice} (Tried: the run cannot be navigated: {error})",
    "worse": f"{WITHHELD} the change that such a finding suggests was tried, and it makes worse {{worse}}. "
    "It was: {advice}",
    "useless": f"{WITHHELD} what such a finding suggests was tried, and neither NIS, the correlation of the "
    "innovations nor the errors across outages get better.",
}
"""Advice after it was tried, with its effect."""

WHEELS = (
    "The vehicle moves along the forward axis of the IMU, in turns too, and does not bank: as one on wheels "
    "or rails does."
)
"""What shows that a vehicle does not slip."""

NO_SLIP = Advice(
    "Set navigator.no_slip: the speeds to the right and down are then measured as zero, which helps where "
    "there is no fix. Tried: error across outages of {outage:.0f} s: {before}, then {after}.",
    (Change("navigator.no_slip", True),),
)
NO_SLIP_AT = Advice(
    "Set navigator.no_slip, and sensors.odometer.lever_arm to {place}: the speeds to the right and down are "
    "then measured as zero, which helps where there is no fix. Tried: error across outages of {outage:.0f} "
    "s: {before}, then {after}.",
    (Change("navigator.no_slip", True), Change("sensors.odometer.lever_arm", "{place}")),
)
"""Advice to measure the speeds of a vehicle that does not slip, and the same with the place where they "
"are."""
