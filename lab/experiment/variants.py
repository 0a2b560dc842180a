"""Variants: the combinations of settings for which the filter is compiled, and their compilation ahead.

A variant is compiled when it is first used, and loaded from the disk from then on. If all are compiled ahead,
nobody waits for the compiler.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

from lab.base.parameters.setting_error import SettingError
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.experiment import Experiment
from lab.navigation.settings import NavigatorSettings

Assignments = Mapping[str, object]

IMU_RATE = 50.0
"""Rate of the flights that compile a variant [Hz]: a short run. The code is that of any rate."""
FILTER_RATE = 10.0
"""A rate of the covariance below that of the IMU [Hz]. The code is that of any such rate."""

_OF_CARDS: tuple[dict[str, object], ...] = tuple(
    {
        "navigator.states": 21,
        "navigator.estimate_misalignments": True,
        "navigator.estimate_g_sensitivity": gyros_feel_force,
    }
    for gyros_feel_force in (True, False)
)
"""The states that the cards of sensors bring (`lab.sensors.cards`)."""
_LOOPS: tuple[dict[str, object], ...] = (
    {},
    {"navigator.smoother": True},
    {"navigator.filter_rate": FILTER_RATE},
)
"""Loops over the samples: forward, also back again, and with a covariance that is propagated less often."""


def variants() -> list[Assignments]:
    """Return the settings of all variants, for `Experiment.update`; those close to the defaults first."""
    models, states, mechanizations = (
        [{f"navigator.{name}": value} for value in NavigatorSettings.param[name].objects]
        for name in ("model", "states", "mechanization")
    )
    states = [*states, *_OF_CARDS]
    choices = [list(enumerate(options)) for options in (models, states, _LOOPS, mechanizations)]
    chosen = sorted(product(*choices), key=lambda choice: sum(place > 0 for place, _ in choice))
    return [{name: value for _, option in choice for name, value in option.items()} for choice in chosen]


def compile_variant(assignments: Assignments) -> bool:
    """Compile the filter for some settings, or load it, by a run of a mission.

    Returns
    -------
    bool
        False if the laboratory refuses the combination: nobody can use it.
    """
    experiment = Experiment()
    experiment.update({"trajectory.imu_rate": IMU_RATE, **assignments})
    try:
        experiment.run()
    except SettingError:
        return False
    return True


def compile_lanes() -> None:
    """Compile runs eight abreast for the default filter and for those of cards, also fast, or load them."""
    for states, rate in product(({}, *_OF_CARDS), (0.0, FILTER_RATE)):
        experiment = Experiment()
        experiment.update({"trajectory.imu_rate": IMU_RATE, "navigator.filter_rate": rate, **states})
        lanes = SeedLanes.of(experiment)
        assert lanes is not None
        list(lanes.measure((experiment.seed,)))


def compile_verdict() -> None:
    """Compile what a verdict needs, with the explanation of innovations that are too large, or load it."""
    experiment = Experiment()
    experiment.update({"trajectory.imu_rate": IMU_RATE, "navigator.r_scale": 0.3})
    _ = experiment.run().verdict


def compile_budget() -> None:
    """Compile the transition of the error budget, which has one variant, or load it."""
    experiment = Experiment()
    experiment.update({"trajectory.imu_rate": IMU_RATE})
    _ = experiment.run().budget
