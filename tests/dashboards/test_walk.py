"""Every page under every kind of run: each draws its own content, or says in a sentence why there is none."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from itertools import combinations, product

import numpy as np
import pytest
from sensor_logs import tables, write
from walking import TITLES, Walk, walking

from dashboards.computing import Outcome
from dashboards.drawn_pages import PAGES
from dashboards.ensembles import ensemble
from dashboards.pages.base import Page
from dashboards.pages.consistency import Consistency
from dashboards.pages.flight import FlightPlots
from dashboards.pages.time_plots import Covariance, Errors
from lab.analysis.verdicts.verdict import Verdict
from lab.experiment.ensembles import seeds
from lab.experiment.ensembles.ensemble import Ensemble
from lab.experiment.experiment import Experiment
from lab.navigation.settings import NavigatorSettings
from lab.sensors.cards import cards

pytestmark = pytest.mark.timeout(1800)
"""Where no kernel is compiled yet, the first test of each model compiles several."""

MODELS, MECHANIZATIONS = (NavigatorSettings.param[name].objects for name in ("model", "mechanization"))
SLOW = ("Budget", "Allan", "Live")
"""Pages that compute for long, or show no result: opened where what they show differs."""
SCALE = ("scale_factor", "scale_factor_sigma")
CARDS = [name for name, card in cards().items() if card.settings()]
TERMS = ("noise_density", "flicker", "bandwidth")
"""Settings of a sensor that the page Allan shows, as far as cards have them."""


def terms_of(name: str) -> frozenset[tuple[str, str]]:
    """Return which of these terms the sensors of a card have."""
    settings = cards()[name].settings()
    return frozenset(
        (sensor, term)
        for sensor in ("gyro", "accelerometer")
        for term in TERMS
        if np.any(settings.get(sensor, {}).get(term, 0.0))
    )


AT_REST = set({terms_of(name): name for name in CARDS}.values())
"""One card of each set of terms: `test_a_card_at_rest_gives_back_its_noise` simulates all of them at rest."""


@pytest.fixture(scope="module")
def walk() -> Iterator[Walk]:
    """Return one page that is open for all walks: what one leaves behind would disturb the next."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        yield opened


@pytest.fixture(autouse=True)
def silence(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """Fail where anything was logged as an error."""
    yield
    told = caplog.get_records("call")  # `caplog.records` are those of the end of the test alone
    assert [one.message for one in told if one.levelno >= logging.ERROR] == []


def experiment(mission: str = "los_angeles", **settings: object) -> Experiment:
    """Return a short flight at a low rate, with settings whose paths have __ for the point."""
    made = Experiment(mission=mission)
    made.set("trajectory.imu_rate", 50)
    for path, value in settings.items():
        made.set(path.replace("__", "."), value)
    return made


def visit(walk: Walk, titles: tuple[str, ...] = TITLES) -> dict[str, list[str]]:
    """Open tabs one after the other; return by title what is wrong with them."""
    wrong = {}
    for title in titles:
        walk.open(title)
        if found := walk.complaints():
            wrong[title] = found
    return wrong


def quick(*more: str) -> tuple[str, ...]:
    return tuple(title for title in TITLES if title not in SLOW or title in more)


LINEAR = {
    ("phi", "north-slaved", 21),
    ("phi", "wander azimuth", 15),
    ("psi", "north-slaved", 15),
    ("psi", "wander azimuth", 21),
    ("invariant", "north-slaved", 21),
    ("invariant", "wander azimuth", 15),
}
"""Every two of model, mechanization and number of states, in filters that other tests compile too."""
NONLINEAR = set(product(("nonlinear",), MECHANIZATIONS, (15, 21)))


def test_every_two_of_the_choices_of_a_filter_are_walked() -> None:
    walked = LINEAR | NONLINEAR
    for one, other in combinations((MODELS, MECHANIZATIONS, (15, 21)), 2):
        for pair in product(one, other):
            assert any(set(pair) <= set(choice) for choice in walked), pair


@pytest.mark.proof
@pytest.mark.parametrize(("model", "mechanization", "states"), sorted(LINEAR | NONLINEAR))
def test_models_mechanizations_and_numbers_of_states(
    walk: Walk, model: str, mechanization: str, states: int
) -> None:
    settings = {"model": model, "mechanization": mechanization, "states": states}
    outcome = walk.run(experiment(**{f"navigator__{name}": value for name, value in settings.items()}))
    if outcome.result is None:
        assert outcome.problem.startswith("navigator.")
        assert "accepted" in outcome.problem
        assert model == "nonlinear"
        return
    everywhere = {("phi", "wander azimuth", 15), ("nonlinear", "north-slaved", 15)}
    titles = TITLES if (model, mechanization, states) in everywhere else quick("Budget")
    assert visit(walk, titles) == {}


@pytest.mark.proof
@pytest.mark.parametrize("name", CARDS)
def test_every_card(walk: Walk, name: str) -> None:
    flown = experiment(navigator__states=21)
    flown = flown.copy()
    settings = cards()[name].settings()
    flown.update({"sensors": settings})
    assert walk.run(flown).problem == ""
    at_rest = ("Allan",) * (name in AT_REST)
    assert visit(walk, ("Covariance", "States", "Innovations", "Verdict", *at_rest, "Compare")) == {}
    for sensor in ("gyro", "accelerometer"):
        errs = any(np.any(settings.get(sensor, {}).get(term, 0.0)) for term in SCALE)
        assert (f"{sensor} scale factors [%]: zero" in covariance_titles(walk)) != errs


def covariance_titles(walk: Walk) -> str:
    walk.open("Covariance")
    return " ".join(fig.title.text for fig in walk.figures())


RUNS: dict[str, dict[str, object]] = {
    "an outage over everything": {"sensors__gps__outages": [(0.0, 1e4)]},
    "an outage over everything, 21 states": {"sensors__gps__outages": [(0.0, 1e4)], "navigator__states": 21},
    "an outage over all but the end": {"sensors__gps__outages": [(0.0, 104.0)]},
    "one fix": {"sensors__gps__period": 60.0},
    "a gate that rejects": {"navigator__gate": 0.01},
    "feedforward": {"navigator__correction": "feedforward"},
    "smoother": {"navigator__smoother": True},
    "filter rate": {"navigator__filter_rate": 1.0},
    "temperature": {"sensors__temperature__profile": "warm_up"},
    "lever arm and latency": {"sensors__gps__lever_arm": (2.0, 0.0, -1.0), "sensors__gps__latency": 0.2},
    "tiny": {
        "navigator__position_sigma": 1e-6,
        "navigator__velocity_sigma": 1e-6,
        "navigator__attitude_sigma": 1e-6,
        "sensors__gyro__noise_density": 0.0,
        "sensors__gyro__bias_sigma": 0.0,
        "sensors__accelerometer__noise_density": 0.0,
        "sensors__accelerometer__bias_sigma": 0.0,
    },
}


@pytest.mark.proof
@pytest.mark.parametrize("kind", RUNS)
def test_every_kind_of_run(walk: Walk, kind: str) -> None:
    outcome = walk.run(experiment(**RUNS[kind]))
    assert outcome.problem == ""
    assert visit(walk, quick("Budget", "Allan")) == {}


@pytest.mark.proof
@pytest.mark.parametrize("reference", [True, False])
def test_a_log(walk: Walk, tmp_path, reference: bool) -> None:
    folder = write(tmp_path / "drive", tables(60, 90), 'title = "Drive"')
    if not reference:
        (folder / "ref.csv").unlink()
    assert walk.run(Experiment(mission=str(folder))).problem == ""
    assert visit(walk) == {}
    reasons = {}
    for title in TITLES:
        walk.open(title)
        if walk.reason:
            reasons[title] = walk.reason
    assert set(reasons) == {"Budget", "Allan"} | (set() if reference else {"Errors"})


@pytest.mark.proof
def test_several_runs_and_one_again(walk: Walk) -> None:
    for states in (15, 21):
        walk.run(experiment(navigator__states=states))
        walk.open("Verdict")
        for runs in (10, 1):
            walk.shown._choice.value = runs
            walk.settle()
            assert walk.complaints() == []
            assert ("10 flights" in walk.text()) == (runs == 10)
            assert len(walk.figures()) == (3 if runs == 10 else 4)
    walk.shown._choice.value = 10
    walk.settle()
    walk.run(experiment(sensors__gps__outages=[(0.0, 1e4)]))
    assert walk.complaints() == []
    walk.shown._choice.value = 1


def test_runs_that_are_done_are_drawn_while_others_go_on(walk: Walk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seeds, "SHOWN_EVERY", 0.0)
    seen: list[tuple[int, int]] = []
    draw = Consistency._draw_runs

    def draw_and_note(page: Consistency, runs: Ensemble, verdict: Verdict | None = None) -> None:
        draw(page, runs, verdict)
        seen.append((len(runs.seeds), len(walk.figures())))

    monkeypatch.setattr(Consistency, "_draw_runs", draw_and_note)
    first = walk.run(experiment(seed=31)).result
    walk.open("Verdict")
    walk.shown._choice.value = 10
    walk.settle()
    counts = [count for count, _ in seen]
    assert len(counts) >= 3
    assert counts == sorted(counts)
    assert counts[-1] == 10
    assert {figures for _, figures in seen} == {3}
    assert "10 flights" in walk.text()
    assert first is not None
    seen.clear()
    walk.shown._draw_some(
        first, ensemble(first, 2, lambda *_: None)
    )  # late, and of a result that is complete
    assert seen == []
    walk.shown._choice.value = 1


def test_runs_that_arrive_after_one_was_chosen_again_are_not_drawn(walk: Walk) -> None:
    outcome = walk.run(experiment(navigator__q_scale=0.1))
    walk.open("Verdict")
    assert outcome.result is not None
    assert "Tried" in walk.text()
    late = Outcome(result=ensemble(outcome.result, 2, lambda *_: None))
    walk.shown._arrive(outcome.result, late)
    assert len(walk.figures()) == 4
    assert "Judged by 1 run," in walk.text()


def test_the_advice_for_a_heading_that_is_too_uncertain_is_applied(walk: Walk) -> None:
    wide = experiment(navigator__attitude_sigma=(0.5, 0.5, 60.0))
    walk.page.session.experiment = wide.copy()
    walk.run(wide)
    walk.open("Verdict")
    page = walk.shown
    assert "Tried: " in walk.text()
    assert page._follow.visible
    page._follow_advice()
    changed = walk.page.session.experiment
    assert changed.navigator.model == "invariant"
    assert changed.copy().update({"navigator.model": "phi"}).to_dict() == wide.to_dict()
    walk.run(changed)
    walk.open("Verdict")
    assert "Consistent" in walk.text()
    assert not page._follow.visible


def test_21_states_of_a_sensor_without_scale_errors_are_said_to_be_zero(walk: Walk) -> None:
    walk.run(experiment(navigator__states=21))
    walk.open("Errors")
    walk.open("Covariance")
    titles = [fig.title.text for fig in walk.figures()]
    assert titles[-2:] == [
        "σ of the gyro scale factors [%]: zero",
        "σ of the accelerometer scale factors [%]: zero",
    ]
    assert not any(title.endswith("zero") for title in titles[:-2])
    walk.run(experiment(navigator__states=21, sensors__gyro__scale_factor_sigma=(1.0, 0.0, 0.0)))
    assert "scale factors [%]: zero" in covariance_titles(walk)


STEPS = ("prepare", "show_time", "missing_reason")


@pytest.mark.proof
@pytest.mark.parametrize(
    ("kind", "step"),
    [*((kind, "draw") for kind in PAGES), *product((Errors, Covariance), STEPS)],
    ids=lambda value: getattr(value, "title", value),
)
def test_a_page_that_fails_says_so_in_its_place_and_leaves_no_other_plots(
    walk: Walk, caplog: pytest.LogCaptureFixture, kind: type[Page], step: str
) -> None:
    def broken(*_given: object) -> str:
        raise OverflowError("cannot convert <b>infinity</b>")

    before, after = experiment(seed=2), experiment(seed=3)
    other = "Flight" if kind is not FlightPlots else "Errors"
    walk.run(before)
    walk.open(other)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kind, step, broken)
        walk.open(kind.title)
        if step != "prepare":
            assert_told(walk, kind.title)
        assert walk.run(after).problem == ""
        if step != "prepare":
            assert_told(walk, kind.title)
        assert any(record.exc_info for record in caplog.records)
        walk.open(other)
        assert walk.complaints() == []
    walk.open(kind.title)
    assert walk.complaints() == []
    caplog.clear()


def assert_told(walk: Walk, title: str) -> None:
    assert (
        f"The page {title} could not be drawn (OverflowError: cannot convert <b>infinity</b>)" in walk.text()
    )
    assert walk.figures() == []


@pytest.mark.proof
@pytest.mark.parametrize("title", ["Verdict", "Allan", "Budget"])
def test_what_is_worked_out_and_cannot_be_drawn_is_said(
    walk: Walk, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, title: str
) -> None:
    def broken(*_given: object) -> str:
        raise OverflowError("cannot convert infinity")

    walk.open(title)
    walk.run(experiment(seed=4))
    if title == "Verdict":
        walk.shown._choice.value = 10
        walk.settle()
    with monkeypatch.context() as patch:
        patch.setattr(type(walk.shown), "paint", broken)
        walk.run(experiment(seed=5))
        assert "could not be drawn (OverflowError: cannot convert infinity)" in walk.text()
        assert all(not drawn(fig) for fig in walk.figures())
        assert any(record.exc_info for record in caplog.records)
    caplog.clear()
    walk.run(experiment(seed=6))
    assert walk.complaints() == []
    if title == "Verdict":
        walk.shown._choice.value = 1


def drawn(fig: object) -> bool:
    """Return whether any glyph of a figure has something to draw."""
    sources = [glyph.data_source for glyph in fig.renderers if hasattr(glyph, "data_source")]
    drawn = [source for source in sources if source.name != "time without GPS"]
    return any(len(values) for source in drawn for values in source.data.values())


def test_the_pages_are_those_of_the_simulator() -> None:
    """The walks name some pages; a renamed one would be left out silently."""
    assert set(SLOW) < set(TITLES)
    assert {Errors.title, Covariance.title} < set(TITLES)
