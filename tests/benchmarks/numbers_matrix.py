"""Numbers: errors after outages with the numbers of `ins-lab numbers`, a data sheet's, and ten times these.

Run it with ``python -m tests.benchmarks.numbers_matrix [../shared [NAME ...]]``. For each pair of a rest and
a drive it prints the geometric mean of the horizontal errors at the end of outages. Their begins are fixed by
the length of the log alone, before anything is computed. The first three filters have the same R, latency and
lever arm, those that identification found, so that only the numbers of the IMU differ; the last two have the
receiver's own R with the data sheet's numbers, and with ten times these.
"""

from __future__ import annotations

import hashlib
import math
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lab.analysis.identification.renavigation import subject
from lab.analysis.identification.withheld import innovations_of_withheld
from lab.base.arrays import FloatArray
from lab.experiment.experiment import Experiment
from lab.experiment.imu_numbers import numbers
from lab.missions.flight_import import read_log
from lab.missions.library import add_log
from tests.sensor_logs import described

SECONDS = 10.0
"""Length of an outage [s]."""
COUNT = 12
"""Number of outages of a log; they may overlap, since each is navigated alone."""
FIRST = 0.25
"""Part of a log before the first begin."""


class Pair(NamedTuple):
    """A rest and a drive.

    Attributes
    ----------
    drive : str
        The drive, below the folder of shared data.
    rest : str
        The log with the rest; empty for the drive's own, or none.
    sensor : str
        The sensor whose data sheet is taken, and why.
    gyro, accelerometer : float
        Its one-sided noise densities [°/s/√Hz], [µg/√Hz].
    source : str
        Public source and licence.
    digest : str
        Begin of the SHA-256 of the drive's file.
    """

    drive: str
    rest: str
    sensor: str
    gyro: float
    accelerometer: float
    source: str
    digest: str


PAIRS = (
    Pair(
        "recordings/rtkx_walk", "", "as its source configures it", 0.0038, 70.0,
        "rtklibexplorer/GNSS_IMU, BSD-3", "f3c05ed4",
    ),
    Pair(
        "logs/copter_delorean_1.bin", "", "MPU-6000, for a simulated Pixhawk", 0.005, 400.0,
        "DependableSystemsLab/DeLorean @ 1095d16, MIT", "e2d94b9b",
    ),
    Pair(
        "logs/copter_delorean_92.bin", "logs/copter_delorean_1.bin", "MPU-6000, for a simulated Pixhawk",
        0.005, 400.0, "DependableSystemsLab/DeLorean @ 1095d16, MIT", "bd7e503c",
    ),
    Pair(
        "logs/copter_61.ulg", "", "ICM-20602 of a Cube Orange", 0.004, 100.0,
        "FSYR-H/PX4_Ulog_Tools @ 56b427d, Apache-2.0", "57c94437",
    ),
    Pair(
        "recordings/comma2k19", "", "LSM6DS3 of an EON", 0.007, 90.0,
        "commaai/comma2k19 Example_1, MIT", "a67123c4",
    ),
)  # fmt: skip
"""Two of the five have a rest of their own, one that of another log of the same sensor, and two have none."""


def mission_of(path: Path, library: Path) -> str:
    """Return a log as a mission of a library."""
    if path.is_dir():
        return str(described(library / path.name, path))
    folder = library / path.stem
    if not folder.exists():
        add_log(read_log([path]), path.stem, title=path.name, folder=library)
    return str(folder)


def errors(experiment: Experiment) -> FloatArray:
    """Return the horizontal errors at the last withheld fix of each outage [m]."""
    again = subject(experiment.run())
    first, last = again.span
    begins = np.linspace(first + FIRST * (last - first), last - SECONDS, COUNT)
    found = []
    for begin in begins:
        withheld = (again.stamps >= begin) & (again.stamps < begin + SECONDS)
        seen = innovations_of_withheld(again, experiment, withheld)
        found.append(math.hypot(*seen.innovation[np.flatnonzero(withheld)[-1], :2]))
    return np.array(found)


def with_densities(experiment: Experiment, pair: Pair, times: float) -> Experiment:
    """Return an experiment with a data sheet's noise, multiplied."""
    changed, fold = experiment.copy(), times / math.sqrt(2)
    for triad, density in (("gyro", pair.gyro), ("accelerometer", pair.accelerometer)):
        changed.set(f"sensors.{triad}.noise_density", fold * density)
        for term in ("flicker", "rate_random_walk", "instability"):
            changed.set(f"sensors.{triad}.{term}", 0.0)
    changed.set("sensors.accelerometer.vibration_density", 0.0)
    return changed


def geometric(values: FloatArray) -> float:
    """Return the geometric mean, of which a centimetre is the least."""
    return float(np.exp(np.mean(np.log(np.maximum(values, 0.01)))))


def row(pair: Pair, shared: Path, library: Path) -> tuple[float, ...]:
    """Return the geometric means [m]: numbers, data sheet, times 10, and data sheet with its own R."""
    drive = Experiment(mission=mission_of(shared / pair.drive, library))
    sheet = with_densities(drive, pair, 1.0)
    rest = None
    if pair.rest:
        rest = still_of(shared / pair.rest, library)
    found = numbers(rest, sheet)
    assert found.experiment is not None  # with a drive
    ours = found.experiment
    same = [ours, with_densities(ours, pair, 1.0), with_densities(ours, pair, 10.0)]
    for one in same[1:]:
        one.set("navigator.q_scale", 1.0)
    return tuple(geometric(errors(one)) for one in (*same, sheet, with_densities(sheet, pair, 10.0)))


def still_of(path: Path, library: Path) -> Path:
    """Return the longest rest at the begin of a log as a csv of its own."""
    log = read_log([path])
    rows = log.time[1:] < 19.0  # the copter takes off after 20 s
    rates, forces = log.rates
    out = library / f"{path.stem}_rest.csv"
    table = np.column_stack((log.time[1:][rows], np.degrees(rates[rows]), forces[rows]))
    header = "t_s,gx_deg_s,gy_deg_s,gz_deg_s,fx_m_s2,fy_m_s2,fz_m_s2"
    np.savetxt(out, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return out


def main() -> None:
    """Print the table."""
    shared = Path(sys.argv[1] if len(sys.argv) > 1 else "../shared")
    print(f"{COUNT} outages of {SECONDS:g} s each; geometric mean of the horizontal errors [m]")
    print(f"{'drive':24}{'numbers':>9}{'sheet':>9}{'x 10':>9}{'ratio':>8}{'ratio':>8}{'own R':>9}{'x 10':>9}")
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        for pair in PAIRS:
            path = shared / pair.drive
            if sys.argv[2:] and path.stem not in sys.argv[2:]:
                continue
            file = path / "imu.csv" if path.is_dir() else path
            if not file.exists():
                print(f"{path.name:24} is not there: {pair.source}")
                continue
            digest = hashlib.sha256(file.read_bytes()).hexdigest()
            if not digest.startswith(pair.digest):
                print(f"{path.name:24} is another file: SHA-256 {digest[:8]}, not {pair.digest}")
                continue
            ours, sheet, tenfold, own, own_tenfold = row(pair, shared, Path(folder))
            ratios.append((ours / sheet, ours / tenfold, ours / own, ours / own_tenfold))
            print(
                f"{path.name:24}{ours:9.3f}{sheet:9.3f}{tenfold:9.3f}{ours / sheet:8.2f}{ours / tenfold:8.2f}"
                f"{own:9.3f}{own_tenfold:9.3f}",
                flush=True,
            )
    if ratios:
        means = np.exp(np.mean(np.log(ratios), axis=0))
        print(
            f"geometric mean of the ratios: {means[0]:.2f} to the data sheet, {means[1]:.2f} to ten times "
            f"it; with the receiver's own R {means[2]:.2f} and {means[3]:.2f}; largest {np.max(ratios):.2f}"
        )


if __name__ == "__main__":
    main()
