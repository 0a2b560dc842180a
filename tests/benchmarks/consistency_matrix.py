"""Consistency matrix: random settings of many seeds each, and whether "Consistent" is said where it is true.

Run it with ``python -m tests.benchmarks.consistency_matrix [settings] [seeds] [first] [kind]``; the kind is
``matched``, ``wrong`` or ``beyond``, and all without one. Of three settings,
the filter of one is matched; in one, R or Q is wrong by a factor of 2 to 10; and one may be beyond the linear
model. A setting is *off* if Student's test of the mean NEES of its runs, of all states over the whole flight,
fails at 1 %: the plainest form of the question. The verdict may then not be consistent, unless the filter is
matched: of matched filters, chance puts 1 % there.

A matched filter knows its sensors, but its model may not hold: then its errors are larger than its σ, and a
verdict that says so is right. Each matched setting that is not called consistent is therefore flown again
with `PROOF` other seeds, by its own model and by the nonlinear one. It counts as *beyond its model* if its
own is off at 1 % there, and the nonlinear one removes `cured_part` of the excess or more. The last lines give
the part of the matched filters that is consistent, of all and without these.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np
from scipy import stats

from lab.analysis.verdicts import limits
from lab.experiment.ensembles import seeds as seeds_module
from lab.experiment.ensembles.ensemble import Ensemble
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.sensor_stages import CACHE
from tests.benchmarks.faults import GRADES, MISSIONS, experiment

PROOF = 300
"""Other seeds that show whether a matched filter is off: they know mean NEES to some 2 %."""
MATCHED, WRONG, BEYOND = "matched", "Q or R wrong", "beyond the linear model"
FIRST = 1001
RATE = 20.0
"""Rate of the IMU [Hz]."""


def setting(number: int) -> tuple[str, str, Experiment]:
    """Return the kind, the description and the experiment of a random setting."""
    rng = np.random.default_rng(number)
    mission, grade = str(rng.choice(MISSIONS)), str(rng.choice(GRADES))
    found = experiment(mission, grade, FIRST + 1000 * number)
    found.set("trajectory.imu_rate", RATE)
    for triad in ("gyro", "accelerometer"):
        density = np.array(getattr(found.sensors, triad).noise_density)
        found.set(f"sensors.{triad}.noise_density", (density * rng.uniform(0.3, 2.0)).tolist())
    found.set("sensors.gps.position_variance", float(10 ** rng.uniform(-1, 1)))
    found.set("sensors.gps.velocity_variance", float(10 ** rng.uniform(-2, 0)))
    found.set("sensors.gps.period", float(rng.choice((0.5, 1.0, 2.0))))
    kind = (MATCHED, WRONG, BEYOND)[number % 3]
    told = f"{mission}, {grade}"
    if kind == WRONG:
        name = str(rng.choice(("navigator.q_scale", "navigator.r_scale")))
        factor = float(rng.uniform(2, 10) ** rng.choice((-1, 1)))
        found.set(name, factor)
        told += f", {name} {factor:.2g}"
    elif kind == BEYOND:
        noise = float(10 ** rng.uniform(-0.7, 0))
        found.set("sensors.gyro.noise_density", noise)
        told += f", gyro {noise:.2g} °/s/√Hz"
    return kind, told, found


def is_off(runs: Ensemble) -> bool:
    """Return whether the mean NEES of the runs is off at 1 %, by the scatter of the runs."""
    return bool(stats.ttest_1samp(runs.mean_nees, runs.degrees).pvalue < 0.01)


def is_beyond_its_model(found: Experiment) -> tuple[bool, str]:
    """Return whether the errors of a matched filter exceed its σ for its model alone, and what shows it."""
    other = found.copy()
    other.set("seed", found.seed + 500)
    as_it_is = run_ensemble(other, PROOF)
    own = float(as_it_is.mean_nees.mean() / as_it_is.degrees)
    other.set("navigator.model", "nonlinear")
    held = run_ensemble(other, PROOF)
    nonlinear = float(held.mean_nees.mean() / held.degrees)
    cured = nonlinear - 1 < (1 - limits.VERDICT.cured_part) * (own - 1)
    told = (
        f"{PROOF} other seeds: NEES/n {own:.3f} with {found.navigator.model}, {nonlinear:.3f} with nonlinear"
    )
    return is_off(as_it_is) and own > 1 and cured, told


def main(arguments: list[str]) -> None:
    """Print the matrix."""
    given = [*arguments, *("200", "30", "0", "")[len(arguments) :]]
    settings, seeds, first = (int(number) for number in given[:3])
    # So few runs are else computed one by one; causes that the innovations show are not asked for.
    seeds_module.FEW, seeds_module.EXPLAINED = 2, 0
    said: dict[str, Counter[str]] = {kind: Counter() for kind in (MATCHED, WRONG, BEYOND)}
    for number in range(first, first + settings):
        kind, told, found = setting(number)
        if given[3] not in kind.lower():
            continue
        runs = run_ensemble(found, seeds)
        consistent, off = bool(runs.verdict.consistent), is_off(runs)
        said[kind]["settings"] += 1
        said[kind]["consistent"] += consistent
        said[kind]["off"] += off
        said[kind]["off and consistent"] += off and consistent
        mean = runs.mean_nees.mean() / runs.degrees
        names = ", ".join(finding.quantity for finding in runs.verdict.findings) or "consistent"
        print(
            f"{number:4} {kind:24} NEES/n {mean:7.3f}{' off' if off else '    '} {names} | {told}", flush=True
        )
        CACHE.clear()
        if kind == MATCHED and not consistent:
            beyond, shown = is_beyond_its_model(found)
            said[kind]["beyond their model"] += beyond
            print(f"     {shown}: {'beyond its model' if beyond else 'falsely accused'}", flush=True)
            CACHE.clear()
    for kind, counts in said.items():
        print(kind, dict(counts))
    matched = said[MATCHED]
    for whom, number in (
        ("of all matched filters", matched["settings"]),
        ("of those whose model holds", matched["settings"] - matched["beyond their model"]),
    ):
        part = 100 * matched["consistent"] / max(number, 1)
        print(f"{whom}, {matched['consistent']} of {number} are consistent: {part:.1f} % (bar 98 %)")


if __name__ == "__main__":
    main(sys.argv[1:])
