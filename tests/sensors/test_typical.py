"""Typical: the table of what is assumed, and whether sensors then err as their grade."""

from __future__ import annotations

import numpy as np
import pytest

from lab.experiment.experiment import Experiment
from lab.experiment.stages import CACHE
from lab.sensors import cards
from lab.sensors.cards import grades, typical_terms
from lab.sensors.suite import TRIADS

TERMS = ("noise_density", "bias_sigma", "flicker", "scale_factor_sigma", "misalignment")


def test_every_grade_has_every_term_with_unit_and_source() -> None:
    assert set(grades()) == set(cards.GRADES) - {"own"}
    for grade, terms in grades().items():
        for triad in TRIADS:
            assert set(TERMS) <= set(terms[triad]), (grade, triad)
            for datum in terms[triad].values():
                assert datum.unit
                assert len(datum.source) > 20
                assert not datum.unit.endswith("/√Hz") or datum.density
    assert typical_terms("own") == {}


def test_what_is_called_the_catalogue_s_is_its_median() -> None:
    for grade, terms in grades().items():
        for triad, data in terms.items():
            for name, datum in data.items():
                if not datum.source.startswith(("median of", "the HG9900")):
                    continue
                given = [
                    np.mean(card.value(triad, name))
                    for card in cards.cards().values()
                    if card.grade == grade
                    and card.name != cards.CLASSIC
                    and name in card.terms.get(triad, {})
                ]
                unit = cards.SensorSuite().groups()[triad].param[name].unit
                assert datum.in_unit(unit) == pytest.approx(np.median(given), rel=0.08), (grade, triad, name)


@pytest.mark.parametrize("triad", TRIADS)
@pytest.mark.parametrize("name", [term for term in TERMS if term != "flicker"])
def test_a_better_grade_errs_less(triad: str, name: str) -> None:
    """In-run instability is left out: that of good consumer gyros is no larger than of industrial ones."""
    unit = cards.SensorSuite().groups()[triad].param[name].unit
    order = [grades()[grade][triad][name].in_unit(unit) for grade in cards.GRADES[:-1]]
    assert order == sorted(order, reverse=True)


def horizontal_error(name: str, seed: int) -> float:
    """Return the horizontal error after an outage of 60 s [m].

    At an IMU rate of 50 Hz: the errors of a card are set for each second, not for each sample.
    """
    experiment = Experiment(mission="los_angeles", seed=seed)
    experiment.set("trajectory.imu_rate", 50)
    cards.card(name).load(experiment)
    experiment.set("sensors.gps.outages", [[30.0, 90.0]])
    result = experiment.run()
    end = int(np.searchsorted(result.time, 90.0)) - 1
    return float(np.hypot(*result.errors.position.values[end][:2]))


@pytest.mark.proof
def test_cards_order_by_grade_after_an_outage_of_a_minute() -> None:
    """All cards, eight seeds: no consumer part beats a tactical one, and the medians of the grades are apart.

    After half a minute of flight the heading of the start still limits the best two grades alike.
    """
    errors: dict[str, dict[str, float]] = {}
    for card in cards.cards().values():
        found = [horizontal_error(card.name, seed) for seed in range(1, 9)]
        CACHE.clear()
        errors.setdefault(card.grade, {})[card.name] = float(np.sqrt(np.mean(np.square(found))))
    for grade, group in errors.items():
        print(grade, {name: round(error, 1) for name, error in group.items()})
    middle = {grade: float(np.median(list(group.values()))) for grade, group in errors.items()}
    assert middle["consumer"] > 1.25 * middle["industrial"] > 1.25 * 1.25 * middle["tactical"]
    assert middle["tactical"] > middle["navigation"]
    assert min(errors["consumer"].values()) > max(errors["tactical"].values())
