"""Finding table: every finding that a verdict can make, with its whole sentences, advice and changes.

Names in braces are fields, which the code that finds it fills: with numbers, with names of what is wrong
(``position``, ``north``, ``gyro``), and with the direction (``too small``). A field is never a part of a
sentence that needs other words around it, so each row can be read, corrected and translated as it stands.
A whole sentence may be a field of another row.
"""

from __future__ import annotations

from itertools import product
from string import Formatter

from lab.analysis.verdicts.advice_table import ADVICE
from lab.analysis.verdicts.finding import Change, Wording
from lab.analysis.verdicts.imu_causes import CAUSES
from lab.analysis.verdicts.pattern import AXES
from lab.analysis.verdicts.run_means import BETWEEN, BLOCKS, NEES, NIS
from lab.analysis.verdicts.sensor_finding_table import SENSOR_FINDINGS
from lab.navigation.aids import NAMES as AIDS

SENSORS = ("gyro", "accelerometer")
"""The inertial sensors."""
EITHER = "GPS or IMU"
"""What findings call a cause that the innovations do not tell."""
CORRELATION, LINEAR_MODEL = "GPS correlation", "linear model"
ARM_OR_LATENCY = "GPS lever arm or latency"
"""What a finding is called whose cause is one of the two: the errors of the fixes do not tell which."""
AID_NOISE = tuple(f"R {aid}" for aid in AIDS)
"""What findings about the noise of measurements other than GPS fixes are called."""
UNEXPLAINED = (NEES, BETWEEN, NIS)
"""What findings without a cause are called."""

_AS_MOTION = "The innovations depend on the motion as errors of the {sensor}s do: {explanation}."
_CORRELATED = (
    "The position innovations are {size} times as large as assumed and correlated in time: the errors of the "
    "fixes are correlated, and the filter assumes that they are white."
)
_LINEAR_UP_TO = "The linear model {model} does not hold there, so its σ does not describe its errors"
_R_KIND = Change("navigator.r", "{multiply}", True)
_OUTLIERS = "outliers, such as those from multipath."

FINDINGS: dict[str, Wording] = {
    # R and the receiver
    "R": Wording(
        "R",
        "The innovations are {size} times as large as assumed: R of the position and the velocity is about "
        "{factor} times {direction}.",
        "Multiply navigator.r_scale by {multiply}.",
        (Change("navigator.r_scale", "{multiply}", True),),
    ),
    "R of a kind": Wording(
        "R {kind}",
        "The {kind} innovations are {size} times as large as assumed: R {kind} is about {factor} times "
        "{direction}.",
        "Multiply the {kind} variances of navigator.r by {multiply}.",
        (_R_KIND,),
    ),
    "R of one channel": Wording(
        "R {kind}",
        "The {kind} innovations are {size} times as large as assumed: R {kind} is about {factor} times "
        "{direction}.",
        "Multiply the {kind} variance of navigator.r by {multiply}.",
        (_R_KIND,),
    ),
    "R of a channel": Wording(
        "R {kind} {axis}",
        "The {kind} errors {axis} of the fixes are {root} times as large as assumed, the others are right: "
        "R {kind} {axis} is about {factor} times {direction}.",
        "Multiply the variance of the {kind} {axis} in navigator.r by {multiply}.",
        (_R_KIND,),
    ),
    "R in a stretch": Wording(
        "R {kind}",
        "From {begin:.0f} s to {end:.0f} s the {kind} errors of the fixes are {root} times as large as "
        "assumed: R {kind} is about {factor} times {direction}. Before and after, these errors are right.",
        "Check the receiver in that time (satellites, multipath). A larger R of position and velocity, or "
        "navigator.robust, covers these errors.",
    ),
    "R in a stretch, by innovations": Wording(
        "R {kind}",
        "From {begin:.0f} s to {end:.0f} s the {kind} innovations are {root} times as large as assumed. "
        "Before and after, they are right.",
        "Check the receiver in that time (satellites, multipath), and outages before it.",
    ),
    "GPS or IMU in a stretch": Wording(
        EITHER,
        "From {begin:.0f} s to {end:.0f} s the {kind} innovations are {root} times as large as assumed. "
        "Before and after, they are right.",
        "Check the receiver in that time (satellites, multipath), and outages before it. Errors of the "
        "inertial sensors in manoeuvres may be the cause instead.",
    ),
    "R of a channel, by innovations": Wording(
        "R {kind} {axis}",
        "The {kind} innovations {axis} are {root} times as large as assumed, the others are right: R {kind} "
        "{axis} is about {factor} times {direction}.",
        "Multiply the variance of the {kind} {axis} in navigator.r by {multiply}.",
        (_R_KIND,),
    ),
    "GPS or IMU in a channel": Wording(
        EITHER,
        "The {kind} innovations {axis} are {root} times as large as assumed, the others are right: R {kind} "
        "{axis} is about {factor} times {direction}, or an error of the IMU shows in this direction.",
        "Multiply the variance of the {kind} {axis} in navigator.r by {multiply}. Errors of the inertial "
        "sensors in manoeuvres may be the cause instead.",
        (_R_KIND,),
    ),
    "GPS latency": Wording(
        "GPS latency",
        "The fixes are {seconds:.2f} s {side}: their errors are proportional to the velocity.",
        "Set navigator.latency to {latency:.2f}.",
        (Change("navigator.latency", "{latency}"),),
    ),
    "GPS lever arm": Wording(
        "GPS lever arm",
        "The lever arm to the antenna is wrong by {length:.1f} m ({place}): the errors of the fixes rotate "
        "with the vehicle.",
        "Set navigator.lever_arm to {arm}.",
        (Change("navigator.lever_arm", "{arm}"),),
    ),
    "GPS lever arm or latency": Wording(
        ARM_OR_LATENCY,
        "The lever arm to the antenna is wrong by {length:.1f} m ({place}), or the fixes are {seconds:.2f} s "
        "{side}: the flight turns and changes its speed too little to tell.",
        "Measure the lever arm. Set navigator.lever_arm to {arm} if the antenna is there, or else "
        "navigator.latency to {latency:.2f}. A flight with turns and changes of speed tells one from the "
        "other.",
        (Change("navigator.lever_arm", "{arm}"),),
    ),
    "GPS correlation": Wording(
        CORRELATION,
        "The position errors of the fixes are correlated, about {sigma:.2g} m over {time:.0f} s; the filter "
        "assumes that they are white.",
        *ADVICE["estimate the slow error"],
    ),
    "GPS correlation, by innovations": Wording(CORRELATION, _CORRELATED, *ADVICE["estimate the slow error"]),
    "hidden GPS correlation": Wording(
        CORRELATION,
        f"{_CORRELATED} Innovations hide the slow part of such errors, so that R is not too large.",
        *ADVICE["estimate the slow error"],
    ),
    "refused outliers": Wording(
        "GPS outliers",
        "The gate rejected {rejected} of {offered} fixes ({percent:.2g} %), where chance rejects "
        "{expected:.2g}: they differ from their neighbours as outliers do, such as those from multipath.",
        "The filter does not use them. Check the antenna and its environment.",
    ),
    "outliers": Wording(
        "GPS outliers",
        f"{{number}} of {{fixes}} fixes have position or velocity errors that are not Gaussian: {_OUTLIERS}",
        "Set navigator.gate to 0.999: the filter then rejects implausible fixes.",
        (Change("navigator.gate", 0.999),),
    ),
    "outliers, by innovations": Wording(
        "GPS outliers",
        f"{{number}} of {{fixes}} fixes have innovations that are not Gaussian: {_OUTLIERS}",
        "Set navigator.gate to 0.999: the filter then rejects implausible fixes.",
        (Change("navigator.gate", 0.999),),
    ),
    "gate": Wording(
        "gate",
        "The gate rejected {rejected} of {offered} fixes ({percent:.2g} %), where chance rejects "
        "{expected:.2g}.",
        "Find out why these fixes are implausible; do not trust the rest before. A Q, R or P₀ that is too "
        "small makes good fixes implausible. Run with navigator.gate 0 and read the verdict on all fixes.",
    ),
    # other measurements
    "noise of a measurement": Wording(
        "R {aid}",
        "The innovations of the {aid} are {root} times as large as the filter says: their assumed noise is "
        "{direction}.",
    ),
    **SENSOR_FINDINGS,
    # the start
    "P0": Wording(
        "P0",
        "The error at the start is {root} times its assumed σ: P₀ is about {factor} times {direction}.",
        "Multiply navigator.p0_scale by {multiply}, or set the initial σ to the values that apply.",
        (Change("navigator.p0_scale", "{multiply}", True),),
    ),
    "P0 of a group": Wording(
        "P0 {group}",
        "The error of the {group} at the start is {root} times its assumed σ: P₀ of the {group} is about "
        "{factor} times {direction}.",
        "Set {setting} to the values that apply, or change the rows of the {group} in navigator.p0.",
        (Change("navigator.p0", "{multiply}", True),),
    ),
    # the innovations as a whole
    "GPS or IMU": Wording(
        EITHER,
        "The innovations are not what the filter expects: {explanation} explains them, and {rival} explains "
        "them nearly as well. The innovations cannot tell GPS from IMU.",
        *ADVICE["compare"],
    ),
    "error in motion": Wording(
        "{cause}", _AS_MOTION, "Calibrate the {sensor}s, or raise the {sensor} noise."
    ),
    "ambiguous error in motion": Wording(
        "{cause}",
        f"{_AS_MOTION} The innovations cannot tell it from this: {{rival}}.",
        "Calibrate the {sensor}s, or raise the {sensor} noise.",
    ),
    "low gain": Wording(
        "gain",
        "The innovations are correlated in time: the filter corrects too little. The most likely cause is "
        "{explanation}.",
        "",
    ),
    "high gain": Wording(
        "gain",
        "The innovations alternate: the filter corrects too much. The most likely cause is {explanation}.",
        "",
    ),
    "NIS": Wording(
        NIS,
        "The innovations are {size} times as large as the filter says, and none of the tested causes "
        "explains it.",
        "Look for errors that the filter does not model.",
    ),
    "NIS, causes not compared": Wording(
        NIS,
        "The innovations are {size} times as large as the filter says. Their causes are not compared: the "
        "filter has further states, or measurements besides the fixes, or rounding spoils its covariance.",
        "Look for errors that the filter does not model.",
    ),
    # errors and innovations without a cause
    "unexplained": Wording(
        "{quantity}",
        "The {values} are {size} times as large as the filter says. Neither R, Q, P₀ nor the timing or place "
        "of the fixes is wrong by enough to explain it.",
    ),
    "unexplained, fixes not judged": Wording(
        "{quantity}",
        "The {values} are {size} times as large as the filter says. Neither Q nor P₀ is wrong by enough to "
        "explain it.",
    ),
    "small innovations": Wording(
        "{quantity}",
        "The {values} are {size} times as large as the filter says. R and the timing and place of the fixes "
        "are not wrong by enough to explain it. A Q or P₀ that is too large hardly shows in innovations: one "
        "of them may be.",
        "Compare Q with the noise of the sensor at rest (Allan deviation), and P₀ with what is known of it.",
    ),
    # the model of the filter
    "feedforward": Wording(
        "feedforward",
        "The attitude error of the navigator that runs free reaches {degrees:.3g}°. The linear model of the "
        "filter does not hold there, so its σ does not describe its errors.",
        "Set navigator.correction to feedback.",
        (Change("navigator.correction", "feedback"),),
    ),
    "correction period": Wording(
        "correction period",
        "The attitude error of the navigator between corrections reaches {degrees:.3g}°. The linear model of "
        "the filter does not hold there, so its σ does not describe its errors.",
        "Set navigator.correction_period to 0.",
        (Change("navigator.correction_period", 0.0),),
    ),
    "linear model at the start": Wording(
        LINEAR_MODEL,
        f"The attitude is uncertain by {{degrees:.3g}}° (1 σ) at the start. {_LINEAR_UP_TO}, except by "
        "chance.",
        *ADVICE["hold large errors"],
    ),
    "linear model in flight": Wording(
        LINEAR_MODEL,
        f"The attitude becomes uncertain by {{degrees:.3g}}° (1 σ). {_LINEAR_UP_TO}.",
        *ADVICE["hold large errors"],
    ),
    "neglected products": Wording(
        LINEAR_MODEL,
        "The cause is beyond the linear model: products of attitude errors, which it neglects, act like "
        "accelerometer biases of {size:.2g} times their σ. {effect}",
        *ADVICE["hold large errors"],
    ),
    "cured by another model": Wording(
        LINEAR_MODEL,
        "The cause is beyond the linear model. Tried where the errors are largest: with {model}, mean NEES "
        "over its degrees of freedom is {after:.2f} instead of {before:.2f}. {effect}",
    ),
    # a user's algorithm
    "covariance": Wording(
        "covariance",
        "The errors are {root} times as large as the algorithm states: its covariance is about {factor} "
        "times {direction}.",
        "Check what the algorithm assumes about the sensors and its start.",
    ),
    "innovation covariance": Wording(
        "innovation covariance",
        "The innovations are {root} times as large as the algorithm states: their covariance is about "
        "{factor} times {direction}.",
        "Check what the algorithm assumes about the fixes.",
    ),
    "low gain of an algorithm": Wording(
        "gain",
        "The innovations are correlated in time: the algorithm corrects too little.",
        "Check what the algorithm assumes about the IMU and about the fixes.",
    ),
    "high gain of an algorithm": Wording(
        "gain",
        "The innovations alternate: the algorithm corrects too much.",
        "Check what the algorithm assumes about the IMU and about the fixes.",
    ),
    "unexplained of an algorithm": Wording(
        "{quantity}",
        "The {values} are {size} times as large as the algorithm states. This is less than half too much or "
        "too little for the flight as a whole.",
        "Check what the algorithm assumes about the sensors, its start and the fixes.",
    ),
    # faults of a log
    "contradiction": Wording(
        "contradiction",
        "The data contradict each other from {since} on. They do not show in which channel. No noise "
        "explains that: it would have to show in the samples, and to predict withheld fixes better.",
        "Look at the axes, signs and units of the sensors, at their ranges, at the clocks of IMU and "
        "receiver, and for lost samples.",
    ),
    "contradiction in a channel": Wording(
        "contradiction",
        "The data contradict each other from {since} on, most likely in {channel}: if it is not believed, "
        "NIS per degree of freedom is {without:.2f} instead of {nis:.2f}. No noise explains that: it would "
        "have to show in the samples, and to predict withheld fixes better.",
        "Look at the axes, signs and units of this sensor, at its range, at the clocks of IMU and receiver, "
        "and for lost samples.",
    ),
    "axes exchanged": Wording(
        "{sensor} axes", "The {first} and the {second} {sensor} are exchanged.", "{remedy}"
    ),
    "wrong sign": Wording("{sensor} axes", "The {axes} {sensor} has the wrong sign.", "{remedy}"),
    "wrong signs": Wording("{sensor} axes", "The {axes} {sensor} have the wrong signs.", "{remedy}"),
    "axes exchanged, wrong sign": Wording(
        "{sensor} axes",
        "The {first} and the {second} {sensor} are exchanged, and then the {axes} {sensor} has the wrong "
        "sign.",
        "{remedy}",
    ),
    "axes exchanged, wrong signs": Wording(
        "{sensor} axes",
        "The {first} and the {second} {sensor} are exchanged, and then the {axes} {sensor} have the wrong "
        "signs.",
        "{remedy}",
    ),
    "left-handed axes": Wording("IMU axes", "The axes of the IMU are left-handed. {which}", "{remedy}"),
    "turned axes": Wording(
        "IMU axes",
        "The IMU is turned about the vertical against the axes that the log states. {which}",
        "{remedy}",
    ),
    "clock": Wording(
        "IMU clock",
        "The clock of the IMU runs {percent} % {side} against that of the receiver: the fixes are {first} at "
        "first, and {last} at the end.",
        "Stamp the samples of the IMU by a clock that the receiver sets, or divide their times by "
        "{ratio:.4f}.",
    ),
    "losses": Wording(
        "IMU losses",
        "{percent} % of the samples of the IMU are lost: its motion in the meantime is unknown.",
        "Find out where samples are lost (bus, logger, link), or lower the rate so that none is.",
    ),
    "headings": Wording(
        "headings",
        "The headings of the log are off by {degrees}°: turned so, they and the motion agree.",
        "Check how the antennas, or the sensor of the heading, and the IMU are mounted, and turn the "
        "headings by {back}°.",
    ),
    "end of the range": Wording(
        "{sensor} range",
        "The {sensor}s are at the end of their range: {ranges}. What goes beyond it is cut off.",
        "Set the range of the {sensor}s larger, or use {sensor}s with a larger range.",
    ),
}
"""The findings by name. Several may be about one quantity."""

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
