"""Comparison: the models of the settings, on the same realisations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lab.base.parameters.setting_error import SettingError
from lab.experiment.ensembles import comparison
from lab.experiment.ensembles.comparison import compare, models
from lab.experiment.experiment import Experiment
from lab.experiment.stages import CACHE
from lab.navigation.settings import NavigatorSettings


@pytest.fixture
def experiment() -> Experiment:
    return Experiment(mission="los_angeles", seed=4)


def test_models_are_those_of_the_settings() -> None:
    assert models() == tuple(NavigatorSettings.param["model"].objects)
    assert "phi" in models()


def test_figures_are_those_of_the_runs(experiment: Experiment) -> None:
    CACHE.clear()
    (row,) = compare(experiment, ["phi"], seeds=(4, 9))
    squares, nees, nis = [], [], []
    for seed in (4, 9):
        result = Experiment(mission="los_angeles", seed=seed).run()
        # The errors of ten samples a second, as in an ensemble.
        names = ("position", "velocity", "attitude")
        squares.append({name: np.mean(result.errors[name].values[::19] ** 2, axis=0) for name in names})
        nees.append(result.consistency.nees.values)
        nis.append(result.innovations.nis.values)
    mean = {name: (squares[0][name] + squares[1][name]) / 2 for name in squares[0]}
    for kind, found in (("position", row.position), ("velocity", row.velocity)):
        assert found == pytest.approx(math.sqrt(sum(mean[kind])))
    assert row.heading == pytest.approx(math.sqrt(mean["attitude"][2]))
    assert row.nees == pytest.approx(np.mean(nees))
    assert row.nis == pytest.approx(np.mean(nis))
    assert row.degrees == 15
    assert 0 < row.seconds < 60
    assert row.verdict.startswith("Consistent")
    assert row.refusal == ""


def test_all_models_run_on_the_same_realisation(experiment: Experiment) -> None:
    """Errors of one realisation are alike from model to model, and differ from seed to seed."""
    rows = {row.model: row for row in compare(experiment)}
    assert tuple(rows) == models()
    for row in rows.values():
        assert row.position == pytest.approx(rows["phi"].position, rel=0.05)
        assert row.velocity == pytest.approx(rows["phi"].velocity, rel=0.05)
    (other,) = compare(Experiment(mission="los_angeles", seed=5), ["phi"])
    assert other.position != pytest.approx(rows["phi"].position, rel=0.01)


def test_a_model_that_does_not_exist_is_answered_with_those_that_do(experiment: Experiment) -> None:
    with pytest.raises(SettingError, match=r"navigator\.model = 'psy'.*one of phi"):
        compare(experiment, ["phi", "psy"])
    with pytest.raises(SettingError, match="none named; accepted are phi"):
        compare(experiment, [])


def test_models_that_all_refuse_are_an_error_that_says_why(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> object:
        raise SettingError("navigator.model: not with this")

    monkeypatch.setattr(comparison, "run_ensemble", refuse)
    with pytest.raises(SettingError, match="not with this"):
        compare(experiment, ["phi"])


def test_the_time_does_not_count_what_was_compiled_before(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    CACHE.clear()
    with monkeypatch.context() as slow:
        slow.setattr("lab.experiment.stages.time_navigation", lambda navigate: (navigate(), 99.0))
        assert experiment.run().seconds == 99
    (row,) = compare(experiment, ["phi"])
    assert 0 < row.seconds < 60


def test_progress_goes_forward_to_the_end(experiment: Experiment) -> None:
    told: list[tuple[str, float]] = []
    compare(experiment, ["phi"], 2, lambda what, done: told.append((what, done)))
    assert [done for _, done in told] == [0.5, 1.0]
    assert told[0][0].startswith("phi, 1 of 2 runs, ")


def test_it_prints_as_a_table_and_gives_a_data_frame(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = comparison.run_ensemble

    def run_or_refuse(variant: Experiment, *given: object, **options: object) -> object:
        if variant.navigator.model == "psi":
            raise SettingError("navigator.model: not with this")
        return run(variant, *given, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(comparison, "run_ensemble", run_or_refuse)
    found = compare(experiment, ["phi", "psi"])
    lines = str(found).splitlines()
    assert len(lines) == 4  # titles, the name of the index, a row for each
    assert "position [m]" in lines[0]
    assert "Does not run: navigator.model" in lines[3]
    frame = found.to_frame()
    assert list(frame.index) == ["phi", "psi"]
    assert frame.loc["phi", "position [m]"] == found[0].position
    assert frame.loc["phi", "NEES expected"] == found[0].degrees
    assert math.isnan(frame.loc["psi", "position [m]"])
