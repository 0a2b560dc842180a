"""Filter programs: the noise of an IMU in the words and units of other programs' own configurations.

Each parameter has its unit, its accepted range and the place where it is documented. A value outside the
range is refused in a comment, not clipped. Continuous densities stay as they are; a program that wants σ of
one step of its filter gets N/√Δt and K/√Δt with the step Δt of that program.

References
----------
Kalibr: wiki page *IMU Noise Model*. PX4: ``src/modules/ekf2/module.yaml``, ``params_gyro_bias.yaml`` and
``params_accel_bias.yaml``; ``EKF/covariance.cpp`` squares Δt times each of them. ArduPilot:
``libraries/AP_NavEKF3/AP_NavEKF3.cpp`` (ranges), ``AP_NavEKF3_core.cpp`` (`CovariancePrediction`),
``AP_NavEKF3_core.h`` (`EKF_TARGET_DT`), ``AP_Scheduler.cpp`` (`SCHED_LOOP_RATE`). robot_localization:
``src/ekf.cpp`` adds Δt Q. KF-GINS: ``dataset/kf-gins.yaml``, ``src/kf-gins/gi_engine.cpp`` (2 σ²/T). MATLAB:
reference pages `gyroparams`, `accelparams` and `insfilterAsync`.

Comments stand on lines of their own: Mission Planner (``ExtLibs/Utilities/ParamFile.cs``) silently skips a
line with more than a name and a value. ROS 2 (``rcl_yaml_param_parser``) refuses an array with an integer
among real numbers.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from lab.base.parameters.toml_file import read_toml
from lab.base.parameters.units import TO_SI
from lab.experiment.number_table import TERMS, ImuNumbers, NumberRow

_UNITS = TO_SI | {"mGal": 1e-5}
"""Units of programs in SI."""
WIDTH = 100
"""Longest line of a comment: the console of PX4 cuts lines at 128 characters, and runs the rest."""


class Limits(NamedTuple):
    """Range of a parameter; `low` itself is outside if `above`."""

    low: float
    high: float
    above: bool = False

    def accepts(self, value: float) -> bool:
        """Return whether a value is in the range."""
        return self.low <= value <= self.high and not (self.above and value == self.low)

    @property
    def words(self) -> str:
        """The range as text."""
        if math.isinf(self.high):
            return f"above {self.low:g}" if self.above else f"{self.low:g} or more"
        return f"{self.low:g} to {self.high:g}"


POSITIVE = Limits(0.0, math.inf, above=True)
"""For programs that document no range: a density of zero stops a filter."""


class Parameter(NamedTuple):
    """A number of a program.

    Attributes
    ----------
    name : str
        Its name in the configuration.
    triad, term : str
        The term it is made of.
    unit : str
        Its unit, and its meaning in a few words.
    factor : float
        What it is made of, in SI units, times this is its value.
    of_sample : bool
        Whether it is also multiplied by the root of the rate of the samples.
    limits : Limits
        Accepted values.
    power : int
        1 for σ, 2 for a variance.
    """

    name: str
    triad: str
    term: str
    unit: str
    factor: float
    of_sample: bool
    limits: Limits
    power: int

    def value(self, row: NumberRow, rate: float) -> float:
        """Return its value."""
        return (row.si * (math.sqrt(rate) if self.of_sample else self.factor)) ** self.power


class Program(NamedTuple):
    """A program with a filter.

    Attributes
    ----------
    title : str
        Name, version and file.
    link : str
        Where the parameters are documented.
    line : str
        Form of a line, with the fields ``name`` and ``value``.
    comment : str
        Begin of a comment.
    parameters : tuple of Parameter
        Its parameters.
    before, after, after_walks : tuple of str
        Further lines, the last of them only with a walk of a bias; a field `rate` is that of the samples.
    notes : tuple of str
        What these numbers do not say.
    """

    title: str
    link: str
    line: str
    comment: str
    parameters: tuple[Parameter, ...]
    before: tuple[str, ...]
    after: tuple[str, ...]
    after_walks: tuple[str, ...]
    notes: tuple[str, ...]


def _read_parameter(row: Mapping[str, Any], program: Mapping[str, Any]) -> Parameter:
    """Return a parameter of the table."""
    factor = program["per_step"] ** -0.5 if "per_step" in program else 1.0
    if "unit_of" in row:
        # The drive of a Gauss-Markov process is 2 σ² / T.
        sigma = math.sqrt(program["correlation"] * 3600 / 2) if row["term"] == TERMS[1] else 1
        factor = sigma / _UNITS[row["unit_of"]]
    limits = Limits(*row["limits"]) if "limits" in row else POSITIVE
    of_sample, power = row.get("of_sample", False), row.get("power", 1)
    return Parameter(row["name"], row["triad"], row["term"], row["unit"], factor, of_sample, limits, power)


def _read_program(row: Mapping[str, Any]) -> Program:
    """Return a program of the table."""
    parameters = tuple(_read_parameter(one, row) for one in row["parameters"])
    texts = (tuple(row.get(name, ())) for name in ("before", "after", "after_walks", "notes"))
    return Program(row["title"], row["link"], row["line"], row.get("comment", "#"), parameters, *texts)


PROGRAMS = {
    name: _read_program(row)
    for name, row in read_toml(Path(__file__).with_name("filter_programs.toml")).items()
}
"""The programs by name. robot_localization also has the walk of the motion; see `lines`."""

_DEFAULT_Q = (0.05, 0.05, 0.06, 0.03, 0.03, 0.06, 0.025, 0.025, 0.04, 0.01, 0.01, 0.02, 0.01, 0.01, 0.015)
"""Diagonal of process_noise_covariance in the example ``params/ekf.yaml`` of robot_localization."""
_WALKS = (slice(9, 12), slice(12, 15))
"""Places of the angular rates and of the accelerations in it."""


def lines(numbers: ImuNumbers, program: str) -> str:
    """Return the lines of a program's configuration with these numbers.

    Parameters
    ----------
    numbers
        The numbers.
    program
        A name in `PROGRAMS`.

    Raises
    ------
    KeyError
        If there is no such program.
    """
    known = PROGRAMS[program]
    begin = known.comment
    source = " and ".join(one for one in (numbers.static, numbers.moving) if one)
    out = [*_comment(begin, f"{known.title}; {known.link}"), *_comment(begin, f"From {source}.")]
    if not numbers.moving:
        out += _comment(
            begin,
            "Without a drive, what the filter needs in the vehicle is not known: these are the sensor's own "
            "numbers.",
        )
    out += known.before
    for parameter in known.parameters:
        out += _parameter_lines(numbers, known, parameter)
    out += [line.format(rate=numbers.rate) for line in known.after]
    if any(row.used > 0 for row in numbers.rows if row.term == TERMS[1]):
        out += known.after_walks
    if program == "robot_localization":
        out += _motion_lines(numbers)
    for note in known.notes:
        out += _comment(begin, note)
    return "\n".join(out)


def _comment(begin: str, words: str) -> list[str]:
    """Return a comment as lines that every program reads whole."""
    begin += " "
    return textwrap.wrap(
        words,
        WIDTH,
        initial_indent=begin,
        subsequent_indent=begin,
        break_on_hyphens=False,
        break_long_words=False,
    )


def _parameter_lines(numbers: ImuNumbers, known: Program, parameter: Parameter) -> list[str]:
    """Return a comment and the line of a parameter, or a comment on why there is none."""
    rows = [row for row in numbers.rows if (row.triad, row.term) == (parameter.triad, parameter.term)]
    if not rows or not rows[0].used > 0:
        known_end = rows[0].at_rest if rows else None
        most = ""
        if known_end is not None:
            row = replace(rows[0], used=known_end.high)
            most = f", at most {parameter.value(row, numbers.rate):.3g} {parameter.unit}"
        why = f"{parameter.name}: not known from these logs{most}; keep the default"
        return _comment(known.comment, why)
    value = parameter.value(rows[0], numbers.rate)
    if not parameter.limits.accepts(value):
        why = (
            f"{parameter.name} would be {value:.4g} {parameter.unit}: refused; the program accepts "
            f"{parameter.limits.words}"
        )
        return _comment(known.comment, why)
    line = known.line.format(name=parameter.name, value=_number(value))
    return [*_comment(known.comment, f"{parameter.unit}; {rows[0].basis}"), line]


def _number(value: float) -> str:
    """Return a number with a point, without which YAML takes it for an integer or for text."""
    mantissa, mark, exponent = f"{value:.4g}".partition("e")
    return mantissa + ("" if "." in mantissa else ".0") + mark + exponent


def _motion_lines(numbers: ImuNumbers) -> list[str]:
    """Return the process noise of robot_localization, which is that of the vehicle's motion."""
    if not numbers.moving:
        return _comment(
            "#",
            "process_noise_covariance: not known without a drive, since it is how the vehicle moves, not how "
            "the IMU measures",
        )
    diagonal = list(_DEFAULT_Q)
    for place, intensity in zip(_WALKS, numbers.motion, strict=True):
        if intensity > 0:
            diagonal[place] = [intensity] * 3
    rows = [
        ", ".join(_number(diagonal[row]) if row == column else "0.0" for column in range(len(diagonal)))
        for row in range(len(diagonal))
    ]
    about = (
        "For ros__parameters of your filter's node. vroll to vyaw and ax to az: random walk of this drive's "
        "rates and accelerations, (rad/s)^2/s and (m/s^2)^2/s; the others are those of the program's example."
    )
    return [
        *_comment("#", about),
        "process_noise_covariance: [" + ",\n                           ".join(rows) + "]",
    ]
