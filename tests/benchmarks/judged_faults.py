"""Judged faults: logs of autopilots with one wrong setting, and what the verdict names.

``python -m tests.benchmarks.judged_faults [SEEDS]`` flies our filter with a wrong setting, writes its
innovations as a log of PX4 and one of ArduPilot, byte by byte, reads them again, and judges them with the
fixes of the flight. It counts over seeds what the verdict names first. Fixes come at 5 Hz, and the inertial
sensors are ten times noisier than by default.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from estimator_logs import ekf3, px4
from sensor_logs import tables, write

from lab.analysis.verdicts.foreign_verdict import ForeignVerdict, judge_foreign
from lab.data.filter_logs import read_filter_log
from lab.data.log.sensor_log import GnssLog
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result

MAGNETOMETER = {
    "sensors.heading.fitted": True,
    "sensors.heading.source": "magnetometer",
    "sensors.heading.bias_sigma": 0.5,
}
DECLINATION = -14.0
"""Magnetic declination at Montréal [°]."""
FAULTS: dict[str, dict[str, object]] = {
    "matched": {},
    "matched, with a magnetometer": MAGNETOMETER,
    "R 10 times too small": {"navigator.r_scale": 0.1},
    "R 10 times too large": {"navigator.r_scale": 10.0},
    "Q 10 times too small": {"navigator.q_scale": 0.1},
    "Q 10 times too large": {"navigator.q_scale": 10.0},
    "lever arm of 2.3 m left out": {
        "sensors.gps.lever_arm": [2.0, 0.5, -1.0],
        "navigator.lever_arm": [0.0, 0.0, 0.0],
    },
    "delay of 0.2 s left out": {"sensors.gps.latency": 0.2, "navigator.latency": 0.0},
    "magnetometer off by 20°": {**MAGNETOMETER, "sensors.heading.declination": DECLINATION + 20},
    "gyros clip at 8 °/s": {"sensors.gyro.range": 8.0},
    "accelerometers clip at 1.05 g": {"sensors.accelerometer.range": 1.05},
    "vibration of 2 m/s²": {},
    "lane switch": {},
    "glitch of 30 m for 10 s": {},
}
RIGHT = {
    "R 10 times too small": ("R too small",),
    "R 10 times too large": ("R too large (remark)",),
    "Q 10 times too small": ("Q too small", "GPS too small"),
    "Q 10 times too large": ("Q too large",),
    "delay of 0.2 s left out": ("delay",),
    "magnetometer off by 20°": ("heading",),
    "gyros clip at 8 °/s": ("delay",),
    "accelerometers clip at 1.05 g": ("GPS too small", "gate"),
    "vibration of 2 m/s²": ("Q too small", "GPS too small"),
    "lane switch": ("lane",),
    "glitch of 30 m for 10 s": ("GPS",),
}
"""What is right to name first; GPS too small says: Q is too small, or errors last. Gyros that clip make the
attitude late, as the sentence of an early fix says; of accelerometers that clip, when and in which channel is
all that is said. Silence is never wrong."""
GLITCH, LANE, SHAKEN = "glitch of 30 m for 10 s", "lane switch", "vibration of 2 m/s²"
VIBRATION = 2.0
"""σ of each sample of the accelerometers [m/s²], white, of which the filter knows nothing."""
BEGIN = 100.0
"""When lane or position change, from the start of the log [s]."""
ORDER = [3, 4, 5, 0, 1, 2]
"""Velocity before position, as autopilots log them."""


class _Sensors:
    """What a verdict needs of a sensor log."""

    def __init__(self, gnss: GnssLog) -> None:
        self.gnss, self.epoch = gnss, 0.0


def flown(fault: str, seed: int, folder: Path) -> Result:
    """Return a flight with one fault: from settings, or from a log whose positions jump."""
    if fault == GLITCH:
        log = tables(20, 200, seed=seed)
        rows = np.abs(log.gnss[:, 0] - log.gnss[0, 0] - BEGIN - 5) <= 5
        log.gnss[rows, 1] += 30 / 111_200
        experiment = Experiment(mission=str(write(folder / "log", log)))
        experiment.navigator.gate = 0.999999
        return experiment.run()
    if fault == SHAKEN:
        log = tables(20, 200, seed=seed)
        log.imu[:, 4:] += VIBRATION * np.random.default_rng(seed).normal(size=(len(log.imu), 3))
        return Experiment(mission=str(write(folder / "log", log))).run()
    experiment = Experiment(mission="montreal", seed=seed)
    experiment.sensors.gps.period = 0.2
    for sensor in (experiment.sensors.gyro, experiment.sensors.accelerometer):
        sensor.noise_density = [10 * one for one in sensor.noise_density]
    for name, value in FAULTS[fault].items():
        experiment.set(name, value)
    return experiment.run()


def judged(result: Result, fault: str, kind: str, folder: Path) -> ForeignVerdict:
    """Return the verdict on a log of PX4 or ArduPilot that is written and read again."""
    arrays, fixes = result.solution_arrays, result.fixes
    nu = arrays.innovation[:, ORDER]
    variance = np.diagonal(arrays.innovation_covariance, axis1=1, axis2=2)[:, ORDER]
    time = fixes.time[: len(nu)]
    primary = np.where(time < BEGIN, 0, 1) if fault == LANE else None
    path = folder / kind
    if kind == "PX4":
        unused = np.zeros((len(nu), 5))
        values, variances = np.hstack((nu, unused)), np.hstack((variance, unused + 1))
        path.write_bytes(px4(time, values, variances, fused=1 << 2, lanes=2, primary=primary))
    else:
        path.write_bytes(ekf3(time, nu, variance, primary=primary))
    ones = np.ones((len(fixes.time), 3))
    gnss = GnssLog(fixes.time, fixes.position, fixes.velocity_n, 3 * ones, 0.1 * ones, np.zeros(3), 0.0)
    return judge_foreign(read_filter_log(path), _Sensors(gnss))  # type: ignore[arg-type]


def named(found: ForeignVerdict) -> str:
    """Return what is accused first, or what the remarks say."""
    if found.verdict.findings:
        first = found.verdict.findings[0]
        return first.quantity.split()[0] + (
            f" {first.direction}" if first.direction.startswith("too") else ""
        )
    large = any("R is too large" in one.sentence for one in found.remarks)
    return "R too large (remark)" if large else "nothing"


def main() -> None:
    """Print the table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    wrong = logs = 0
    with tempfile.TemporaryDirectory() as place:
        for fault in FAULTS:
            counts = {"PX4": Counter(), "ArduPilot": Counter()}
            for seed in range(1, seeds + 1):
                result = flown(fault, seed, Path(place))
                for kind, count in counts.items():
                    what = named(judged(result, fault, kind, Path(place)))
                    count[what] += 1
                    logs += 1
                    wrong += what not in ("nothing", *RIGHT.get(fault, ()))
            said = "  ".join(
                f"{kind}: " + ", ".join(f"{what} {number}" for what, number in count.most_common())
                for kind, count in counts.items()
            )
            print(f"{fault:30}{said}", flush=True)
    print(f"something else is named first: {wrong} of {logs} logs")


if __name__ == "__main__":
    main()
