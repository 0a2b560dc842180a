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
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from lab.base.parameters.units import TO_SI
from lab.experiment.number_table import TERMS, ImuNumbers, NumberRow

STEP_PX4 = 0.01
"""EKF2_PREDICT_US, 10 000 µs: the step of EKF2 [s]."""
STEP_ARDUPILOT = 0.012
"""EKF_TARGET_DT: the step of EKF3 [s]."""
CORRELATION = 1.0
"""Correlation time of KF-GINS that is written [h]: longer than a drive, so that its process is a random
walk there."""
MILLIGAL = 1e-5
"""[m/s²]."""
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
    factor : callable
        What it is made of, in SI units, times this at the rate of the samples [Hz] is its value.
    limits : Limits
        Accepted values.
    power : int
        1 for σ, 2 for a variance.
    """

    name: str
    triad: str
    term: str
    unit: str
    factor: Callable[[float], float]
    limits: Limits = POSITIVE
    power: int = 1

    def value(self, row: NumberRow, rate: float) -> float:
        """Return its value."""
        return (row.si * self.factor(rate)) ** self.power


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
    before: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    after_walks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def _unchanged_value(_rate: float) -> float:
    return 1.0


def _divide_by_root(step: float) -> Callable[[float], float]:
    return lambda _rate: step**-0.5


def _four(
    names: tuple[str, str, str, str],
    units: tuple[str, str, str, str],
    factors: tuple[Callable[[float], float], ...],
    limits: tuple[Limits, ...] = (POSITIVE,) * 4,
) -> tuple[Parameter, ...]:
    """Return white noise of gyros and accelerometers, and the walks of their biases."""
    terms = [(triad, term) for term in TERMS for triad in ("gyro", "accelerometer")]
    return tuple(
        Parameter(name, *term, unit, factor, limit)
        for name, term, unit, factor, limit in zip(names, terms, units, factors, limits, strict=True)
    )


PROGRAMS = {
    "kalibr": Program(
        "Kalibr, imu.yaml (master, 2023 and later)",
        "https://github.com/ethz-asl/kalibr/wiki/IMU-Noise-Model",
        "{name}: {value}",
        "#",
        _four(
            (
                "gyroscope_noise_density",
                "accelerometer_noise_density",
                "gyroscope_random_walk",
                "accelerometer_random_walk",
            ),
            (
                "rad/s/sqrt(Hz), continuous, two-sided",
                "m/s^2/sqrt(Hz), continuous, two-sided",
                "rad/s^2/sqrt(Hz), continuous",
                "m/s^3/sqrt(Hz), continuous",
            ),
            (_unchanged_value,) * 4,
        ),
        after=("# Hz", "update_rate: {rate:.6g}"),
        notes=("rostopic is yours.",),
    ),
    "px4": Program(
        "PX4 v1.14 to v1.16, EKF2 parameters",
        "https://docs.px4.io/main/en/advanced_config/parameter_reference.html",
        "param set {name} {value}",
        "#",
        _four(
            ("EKF2_GYR_NOISE", "EKF2_ACC_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE"),
            (
                "rad/s, sigma of one step of 10 ms",
                "m/s^2, sigma of one step of 10 ms",
                "rad/s^2, step of the bias over 10 ms",
                "m/s^3, step of the bias over 10 ms",
            ),
            (_divide_by_root(STEP_PX4),) * 4,
            (Limits(0.0001, 0.1), Limits(0.01, 1.0), Limits(0.0, 0.01), Limits(0.0, 0.01)),
        ),
        notes=(
            "They hold for EKF2_PREDICT_US 10000; with another step, multiply by sqrt(10000/step).",
            "In newer versions, the variance of a bias only grows while its sigma is below EKF2_GYR_NOISE or "
            "EKF2_ACC_NOISE.",
        ),
    ),
    "ardupilot": Program(
        "ArduPilot 4.4 to 4.7, EKF3 parameters",
        "https://ardupilot.org/copter/docs/parameters.html#ek3-gyro-p-nse",
        "{name},{value}",
        "#",
        _four(
            ("EK3_GYRO_P_NSE", "EK3_ACC_P_NSE", "EK3_GBIAS_P_NSE", "EK3_ABIAS_P_NSE"),
            (
                "rad/s, sigma of one step of 12 ms",
                "m/s/s, sigma of one step of 12 ms",
                "rad/s/s, step of the bias over 12 ms",
                "m/s/s/s, step of the bias over 12 ms",
            ),
            (_divide_by_root(STEP_ARDUPILOT),) * 4,
            (Limits(0.0001, 0.1), Limits(0.01, 1.0), Limits(0.00001, 0.001), Limits(0.00001, 0.02)),
        ),
        notes=(
            "They hold for SCHED_LOOP_RATE of 84 or more, as of Copter and Sub. The step of EKF3 is no "
            "shorter than the loop's: at 50, the default of Plane and Rover, multiply by 0.775, sqrt(12/20).",
        ),
    ),
    "kf-gins": Program(
        "KF-GINS 1.0, kf-gins.yaml",
        "https://github.com/i2Nav-WHU/KF-GINS/blob/main/dataset/kf-gins.yaml",
        "  {name}: [{value}, {value}, {value}]",
        "#",
        _four(
            ("arw", "vrw", "gbstd", "abstd"),
            ("deg/sqrt(hr)", "m/s/sqrt(hr)", "deg/hr, with corrtime", "mGal, with corrtime"),
            (
                lambda _rate: 1 / TO_SI["°/√h"],
                lambda _rate: 1 / TO_SI["m/s/√h"],
                lambda _rate: math.sqrt(CORRELATION * 3600 / 2) / TO_SI["°/h"],
                lambda _rate: math.sqrt(CORRELATION * 3600 / 2) / MILLIGAL,
            ),
        ),
        before=("imunoise:",),
        after_walks=(
            "# hr; the drive of each process is 2 std^2/corrtime. Where you change corrtime, gsstd and asstd",
            "# keep their drive if they are multiplied by the root of its change",
            f"  corrtime: {CORRELATION}",
        ),
        notes=(
            "Keep your lines gsstd and asstd in this section, and any that is not known: without one of "
            "them, the program ends.",
            "initbgstd and initbastd are not known from noise: without them, the program starts with gbstd "
            "and abstd as the sigma of the turn-on bias.",
        ),
    ),
    "matlab": Program(
        "MATLAB R2022b and later, Navigation Toolbox",
        "https://www.mathworks.com/help/nav/ref/insfilterasync.html",
        "{name} = {value};",
        "%",
        (
            Parameter("gyro.NoiseDensity", "gyro", TERMS[0], "(rad/s)/sqrt(Hz)", _unchanged_value),
            Parameter("gyro.RandomWalk", "gyro", TERMS[1], "(rad/s)*sqrt(Hz)", _unchanged_value),
            Parameter("accel.NoiseDensity", "accelerometer", TERMS[0], "(m/s^2)/sqrt(Hz)", _unchanged_value),
            Parameter("accel.RandomWalk", "accelerometer", TERMS[1], "(m/s^2)*sqrt(Hz)", _unchanged_value),
            Parameter("gyroCovariance", "gyro", TERMS[0], "(rad/s)^2, for fusegyro", math.sqrt, power=2),
            Parameter(
                "accelCovariance", "accelerometer", TERMS[0], "(m/s^2)^2, for fuseaccel", math.sqrt, power=2
            ),
            Parameter("filter.GyroscopeBiasNoise", "gyro", TERMS[1], "(rad/s)^2", _unchanged_value, power=2),
            Parameter(
                "filter.AccelerometerBiasNoise",
                "accelerometer",
                TERMS[1],
                "(m/s^2)^2",
                _unchanged_value,
                power=2,
            ),
        ),
        before=(
            "gyro = gyroparams('NoiseType', 'single-sided');",
            "accel = accelparams('NoiseType', 'single-sided');",
            "filter = insfilterAsync;",
        ),
        notes=(
            "'single-sided' makes sigma of a sample NoiseDensity*sqrt(rate), so that NoiseDensity is N of "
            "IEEE 952; with 'double-sided', the default, multiply NoiseDensity by sqrt(2).",
        ),
    ),
    "robot_localization": Program(
        "robot_localization 3 (ROS 2), ekf.yaml and sensor_msgs/Imu",
        "https://docs.ros.org/en/rolling/p/robot_localization/configuring_robot_localization.html",
        "# {name}: {value}",
        "#",
        (
            Parameter(
                "angular_velocity_covariance diagonal", "gyro", TERMS[0], "(rad/s)^2", math.sqrt, power=2
            ),
            Parameter(
                "linear_acceleration_covariance diagonal",
                "accelerometer",
                TERMS[0],
                "(m/s^2)^2",
                math.sqrt,
                power=2,
            ),
        ),
        notes=(
            "The filter takes the IMU as a measurement: its noise stands in the covariances of the messages "
            "of its driver. It has no biases, so the random walks have no place.",
        ),
    ),
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
