"""Finding table: every finding that a verdict can make; ``findings.toml`` has the sentences and the advice.

Names in braces are fields, which the code that finds it fills: with numbers, with names of what is wrong
(``position``, ``north``, ``gyro``), and with the direction (``too small``). A field is never a part of a
sentence that needs other words around it, so each row can be read, corrected and translated as it stands.
A whole sentence may be a field of another row.
"""

from __future__ import annotations

from itertools import product
from string import Formatter

from lab.analysis.verdicts.advice_table import ADVICE, TABLES, read_advice
from lab.analysis.verdicts.finding import Wording
from lab.analysis.verdicts.imu_causes import CAUSES
from lab.analysis.verdicts.pattern import AXES
from lab.analysis.verdicts.run_means import BETWEEN, BLOCKS, NEES, NIS
from lab.navigation.aids import NAMES as AIDS


def _read_findings(table: str) -> dict[str, Wording]:
    """Return the findings of a table by name; their advice is their own, or that of a name."""
    return {
        name: Wording(
            row["quantity"],
            row["sentence"],
            *(ADVICE[row["advised"]] if "advised" in row else read_advice(row)),
        )
        for name, row in TABLES[table].items()
    }


FINDINGS, FOREIGN_FINDINGS = _read_findings("findings"), _read_findings("foreign")
"""The findings by name, and those about a filter that is not ours. Several may be about one quantity."""

SENSORS = ("gyro", "accelerometer")
"""The inertial sensors."""
EITHER = FINDINGS["GPS or IMU"].quantity
"""What findings call a cause that the innovations do not tell."""
CORRELATION, LINEAR_MODEL = (
    FINDINGS[name].quantity for name in ("GPS correlation", "linear model in flight")
)
ARM_OR_LATENCY = FINDINGS["GPS lever arm or latency"].quantity
"""What a finding is called whose cause is one of the two: the errors of the fixes do not tell which."""
EARTH_RATE = FINDINGS["Earth rate"].quantity
"""What a finding is called if the rate of the Earth is left out."""
AID_NOISE = tuple(FINDINGS["noise of a measurement"].quantity.format(aid=aid) for aid in AIDS)
"""What findings about the noise of measurements other than GPS fixes are called."""
UNEXPLAINED = (NEES, BETWEEN, NIS)
"""What findings without a cause are called."""

FAULT_OF_LOG = "{fault} The data contradict each other from {since} on."
"""The sentence of a finding about a fault of a log, which has its own sentence."""
AS_LIKELY = " Or, as likely: "
"""Words between the sentences of faults that explain the data equally well."""

_NAMES: dict[str, tuple[str, ...]] = {
    "kind": ("position", "velocity"),
    "axis": AXES,
    "aid": AIDS,
    "sensor": SENSORS,
    "group": tuple(BLOCKS),
    "cause": tuple(CAUSES),
    "quantity": UNEXPLAINED,
}
"""What the fields of quantities stand for."""


def _quantities(template: str) -> list[str]:
    """Return all quantities of a row of the table."""
    fields = [name for _, name, _, _ in Formatter().parse(template) if name]
    chosen = product(*(_NAMES[name] for name in fields))
    return [template.format(**dict(zip(fields, names, strict=True))) for names in chosen]


FINDING_NAMES: tuple[str, ...] = tuple(
    dict.fromkeys(name for row in FINDINGS.values() for name in _quantities(row.quantity))
)
"""Every quantity that a finding may have, for checks that name one."""

EXPLANATIONS: dict[str, str] = {
    "GPS latency": "a GPS latency of {size} s",
    "GPS lever arm": "a GPS lever arm of {size} m",
    CORRELATION: "a correlated error of the fixes",
    "gyro scale factor": "a gyro scale factor error of {percent} %",
    "gyro misalignment": "a gyro misalignment of {degrees}°",
    "gyro bias drift": "a gyro bias drift",
    "gyro g-sensitivity": "a gyro g-sensitivity",
    "gyro bandwidth": "a limited bandwidth of the gyros",
    "accelerometer scale factor": "an accelerometer scale factor error of {percent} %",
    "accelerometer misalignment": "an accelerometer misalignment of {degrees}°",
    "accelerometer bias drift": "an accelerometer bias drift",
    "accelerometer bandwidth": "a limited bandwidth of the accelerometers",
}
"""What findings call the errors that may explain the innovations, each with its article."""
VARIANCE = "{variance} {factor} times {direction}"
"""The same of a wrong variance."""

VALUES: dict[str, str] = {
    NEES: "errors of the states",
    f"{NEES} of a group": "errors of the {group}",
    BETWEEN: "errors of the position between the fixes",
    NIS: "innovations",
    f"{NIS} of a group": "innovations of the {group}",
}
"""What the values are called of which a figure is the mean."""
TOGETHER, IN_QUARTER = "{values}, taken together,", "{values} in the {quarter} quarter of the flight"
"""The same of all values together, which each may fit its own σ, and of those in a part of the flight."""
