"""Card axes: error over σ of each axis after a minute without fixes, for each card.

Run it with ``python -m tests.benchmarks.card_axes [seeds] [--as-loaded] [words in names or missions]``. The
seeds begin with 1001, and 100 are usual. Each seed flies the three missions with an outage that begins
anywhere after the filter has converged; runs are eight abreast, as those of ``ins-lab outage``. A row holds
the rms of error over σ of position and attitude at the ends of the outages with its 95 % interval, and the
rms horizontal error. A figure outside 0.8 to 1.2 is marked with !; the last line lists those whose intervals
are outside, too.

A card has its misalignments and g-sensitivities with one sign, which no seed changes. So each eight runs get
random signs, unless ``--as-loaded`` is given: with the same signs in all runs, an axis may have a ratio of
1.25 that is 1.00 over all signs.
"""

from __future__ import annotations

import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from lab.analysis.budget import sigma_of_quantities
from lab.analysis.errors import compute_errors
from lab.base.arrays import FloatArray
from lab.base.processors import processors
from lab.experiment.ensembles.outage_blocks import Block, plan_blocks
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.ensembles.seeds import at_fast_rate
from lab.experiment.experiment import Experiment
from lab.experiment.sensor_stages import SensorStages
from lab.missions import mission as mission_named
from lab.motion.frames.rotation import euler_from_quaternion
from lab.navigation.model_choice import chosen_model
from lab.sensors.cards import Card, cards
from tests.benchmarks.card_matrix import FIRST, RATIO, judged
from tests.benchmarks.faults import MISSIONS

SECONDS = 60.0
"""Length of the outages [s]."""
AXES = {"east": 0, "north": 1, "down": 2, "roll": 6, "pitch": 7, "heading": 8}
"""Judged quantities, with their places among the errors."""
_ROOM = threading.local()


def at_ends(card: Card, mission: str, seeds: int, *, drawn: bool) -> FloatArray:
    """Return errors and σ (2, seeds, 9) of a card at the ends of outages: position, velocity, attitude."""
    loaded = Experiment(mission=mission)
    card.load(loaded)
    loaded = at_fast_rate(loaded)
    flight = SensorStages(loaded, mission_named(mission)).kept_flight()
    receiver, step = loaded.sensors.gps, 1 / float(loaded.trajectory.imu_rate)
    navigator, blocks = chosen_model(loaded.navigator).blocks, plan_blocks(loaded, SECONDS, _numbers(seeds))

    def of_block(block: Block) -> FloatArray:
        end = block.begin + SECONDS
        sample = np.searchsorted(flight.ideal.time, [end - step / 2])
        outage = block.begin + receiver.period / 2, end + receiver.latency + step / 2
        lanes = SeedLanes.of(with_signs(loaded, block.seeds[0]) if drawn else loaded)
        assert lanes is not None, f"{card.name}: its runs cannot be abreast"
        found = []
        for run in lanes.during(outage, end, _ROOM).navigate(block.seeds, sample):
            assert run is not None, f"{card.name}: a run cannot be abreast of others"
            one = run.solution
            sigma = sigma_of_quantities(
                euler_from_quaternion(one.q_nb), one.variance, one.covariance, navigator
            )
            errors = compute_errors(one.position, one.velocity_n, one.q_nb, flight.truth.taken(sample))
            found.append(np.concatenate((errors, sigma[:, :9])))
        return np.stack(found, axis=1)

    with ThreadPoolExecutor(processors()) as pool:
        return np.concatenate(list(pool.map(of_block, blocks)), axis=1)


def _numbers(seeds: int) -> range:
    return range(FIRST, FIRST + seeds)


def with_signs(experiment: Experiment, seed: int) -> Experiment:
    """Return a copy whose misalignments and g-sensitivities have random signs; the filter's σ stay."""
    found, rng = experiment.copy(), np.random.default_rng(seed)
    gyro, accelerometer = found.sensors.gyro, found.sensors.accelerometer
    for triad, name in (
        (gyro, "misalignment"),
        (accelerometer, "misalignment"),
        (gyro, "g_sensitivity"),
    ):
        sizes = np.array(getattr(triad, name))
        setattr(triad, name, tuple((sizes * rng.choice((-1.0, 1.0), sizes.size)).tolist()))
    return found


def rms_with_interval(ratios: FloatArray) -> tuple[float, float, float]:
    """Return the rms of ratios (n,), and the ends of its 95 % interval by the scatter of their squares."""
    squares = ratios**2
    mean, error = float(squares.mean()), 1.96 * float(squares.std(ddof=1)) / len(squares) ** 0.5
    return mean**0.5, max(mean - error, 0.0) ** 0.5, (mean + error) ** 0.5


def main(arguments: list[str]) -> None:
    """Print a row for each card, and which cards are outside the bounds by more than chance."""
    words = [word for word in arguments if word != "--as-loaded"]
    drawn = "--as-loaded" not in arguments
    seeds = int(words.pop(0)) if words and words[0].isdigit() else 100
    missions = [name for name in MISSIONS if name in words] or list(MISSIONS)
    words = [word for word in words if word not in MISSIONS]
    outside, count = list[str](), 0
    for name, card in cards().items():
        if set(card.terms) == {"gps"} or (words and not any(word in name for word in words)):
            continue
        errors, sigma = np.concatenate(
            [at_ends(card, mission, seeds, drawn=drawn) for mission in missions], axis=1
        )
        line, count = list[str](), count + 1
        for axis, place in AXES.items():
            ratio, low, high = rms_with_interval(errors[:, place] / sigma[:, place])
            line.append(f"{axis} {judged(ratio, RATIO)} ({low:.2f} to {high:.2f})")
            if high < RATIO[0] or low > RATIO[1]:
                outside.append(f"{name} {axis} {ratio:.2f}")
        rms = float(np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))))
        print(f"{card.grade:10} {name:20} {', '.join(line)}; {rms:.1f} m", flush=True)
    print(
        f"{count} cards; outside {RATIO[0]} to {RATIO[1]} by more than chance: {', '.join(outside) or 'none'}"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
