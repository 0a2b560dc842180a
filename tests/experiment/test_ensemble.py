"""Ensemble: its runs are those of the experiment one by one, and its averages those of χ²."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import lab.experiment.ensembles.seeds as seeds_module
from lab.analysis.verdicts.innovation_evidence import LAGS
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import StoppedError
from lab.experiment.ensembles.collected import Collected
from lab.experiment.ensembles.ensemble import QUANTITIES, Ensemble
from lab.experiment.ensembles.run_at_fixes import keep_values
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.navigation.checks import DivergedError, divergence_error

SEEDS = 40


@pytest.fixture(scope="module")
def many() -> Ensemble:
    """Return many runs of a matched filter."""
    ensemble = run_ensemble(Experiment(mission="los_angeles", seed=5), SEEDS)
    CACHE.clear()
    return ensemble


@pytest.mark.proof
def test_runs_are_those_of_the_experiment_with_their_seeds(many: Ensemble) -> None:
    assert many.seeds == tuple(range(5, 5 + SEEDS))
    for row in (0, 7):
        result = Experiment(mission="los_angeles", seed=many.seeds[row]).run()
        assert np.array_equal(many.time, result.fixes.time)
        single = run_ensemble(result.experiment, 1)
        assert np.array_equal(single.consistency.anees, result.consistency.nees)
        assert np.array_equal(single.consistency.anis, result.innovations.nis)
        assert many.mean_nees[row] == pytest.approx(float(result.consistency.nees.mean()), rel=1e-12)
        assert many.mean_nis[row] == pytest.approx(float(result.innovations.nis.mean()), rel=1e-12)
        assert np.array_equal(many.rms[row], single.rms[0])
        # Ten samples a second: 19 are closest to 20 without a common factor with the 200 of a fix interval.
        groups = [result.errors[name].values[::19] for name in ("position", "velocity", "attitude")]
        np.testing.assert_allclose(many.rms[row], np.sqrt(np.mean(np.hstack(groups) ** 2, axis=0)), rtol=1e-9)
        np.testing.assert_allclose(many.rms[row], result.summary["rms"], rtol=5e-3)
        assert (many.largest[row] <= result.summary["max"] + 1e-9).all()
        np.testing.assert_allclose(many.largest[row], result.summary["max"], rtol=0.3)
        north = result.errors.position.sel(axis="north").interp(time=many.time)
        assert np.allclose(single.errors["mean"].sel(quantity="position north"), north, atol=1e-2)
        assert many.verdicts[row] == result.verdict
    assert (many.seconds > 0).all()


@pytest.mark.parametrize("model", ["phi", "nonlinear"])
def test_horizontal_figures_are_those_of_the_runs(model: str) -> None:
    """Whether they run abreast or alone: the 95 % quantile, and the rms at the ends of two outages."""
    outages = [[30.0, 40.0], [60.003, 80.0]]
    changes = {"trajectory.imu_rate": 50.0, "sensors.gps.outages": outages, "navigator.model": model}
    experiment = Experiment(mission="los_angeles").update(changes)
    many = run_ensemble(experiment, 9)
    for row in (0, 8):
        result = experiment.copy().update({"seed": many.seeds[row]}).run()
        horizontal = np.hypot(*result.errors.position.values[:, :2].T)
        ends = [int(np.flatnonzero(result.time < end - 0.01)[-1]) for end in (40.0, 80.0)]
        at_ends = many.horizontal_at_outage_ends[row]
        assert at_ends == pytest.approx(np.sqrt(np.mean(horizontal[ends] ** 2)), rel=1e-6)
        for place, group in enumerate((result.errors, result.sigma)):
            nine = np.hstack([group[name].values[ends] for name in ("position", "velocity", "attitude")])
            of_run = many.at_outage_ends[row, place]
            np.testing.assert_allclose(of_run, np.sqrt(np.mean(nine**2, axis=0)), rtol=1e-6)
        assert many.most[row] == pytest.approx(np.quantile(horizontal, 0.95), rel=0.02)
    assert np.isnan(
        run_ensemble(experiment.copy().update({"sensors.gps.outages": []}), 1).at_outage_ends
    ).all()


def test_averages_and_intervals_are_those_of_chi_square(many: Ensemble) -> None:
    data = many.consistency
    for name, of_runs, degrees in (("anees", many.mean_nees, 15), ("anis", many.mean_nis, 6)):
        assert float(data[name].mean()) == pytest.approx(of_runs.mean(), rel=1e-12)
        low, high = stats.chi2.interval(0.95, degrees * SEEDS)
        assert np.allclose(data[f"{name}_low"], low / SEEDS)
        assert np.allclose(data[f"{name}_high"], high / SEEDS)
    nees, nis = many.inside(after=20)
    print(f"\n{SEEDS} seeds: NEES inside at {100 * nees:.1f} %, NIS at {100 * nis:.1f} % of the epochs")
    assert nees > 0.85
    assert nis > 0.85


def test_between_fixes_the_position_is_judged_just_before_them(many: Ensemble) -> None:
    """Also in an outage, in which there is no fix: by the errors and the covariance at the same times."""
    gap = Experiment(mission="los_angeles", seed=5)
    gap.set("sensors.gps.outages", [[40, 70]])
    together = run_ensemble(gap, 3)
    grid = together.between.time
    inside = (grid > 41) & (grid < 69)
    assert inside.sum() == 28
    assert not np.isin(grid, together.time).any()
    result = gap.run()
    at = np.searchsorted(result.time, grid)
    assert np.array_equal(result.time[at], grid)
    x = np.stack([result.errors.position.values[at, axis] for axis in (1, 0, 2)], axis=-1) * [1, 1, -1]
    sigma = np.sqrt(result.solution_arrays.variance[at][:, :3])
    lowest = np.max((x / sigma) ** 2, axis=1)  # NEES is at least the square of each error in its σ
    assert np.all(run_ensemble(gap, 1).between.mean("nees") > 0.999 * lowest)
    data = many.consistency
    low, high = stats.chi2.interval(0.95, 3 * SEEDS)
    assert np.allclose(data["anees_between_low"], low / SEEDS)
    assert np.allclose(data["anees_between_high"], high / SEEDS)
    late = many.between.time > 20
    mean = data["anees_between"].values[late]
    assert np.mean((low / SEEDS < mean) & (mean < high / SEEDS)) > 0.8


def test_coverage_of_a_matched_filter_is_that_of_the_normal_distribution(many: Ensemble) -> None:
    """Errors of 40 flights, correlated along each: a percent or two off."""
    table = many.coverage.set_index("quantity")
    assert list(table.index) == list(QUANTITIES)
    assert np.allclose(table["within ±1σ [%]"], 68.27, atol=9)
    assert (table["within ±3σ [%]"] > 98.5).all()
    assert (table["mean [σ]"].abs() < 2 * table["mean ±"]).all()
    assert "Consistent" in repr(many)


def test_whiteness_of_all_runs_is_that_of_their_innovations_together(many: Ensemble) -> None:
    """Pooled by hand; and of a matched filter within limits that one in a thousand exceeds."""
    runs = [Experiment(mission="los_angeles", seed=seed).run() for seed in many.seeds[:3]]
    sets = [run.innovations for run in runs]
    kinds = ("position", "velocity")
    values = [np.hstack([(one[kind] / one[f"{kind}_sigma"]).values for kind in kinds]) for one in sets]
    three = run_ensemble(runs[0].experiment, 3).whiteness
    assert np.allclose(three["mean"], np.concatenate(values).mean(axis=0))
    assert np.allclose(three["variance"], np.mean(np.concatenate(values) ** 2, axis=0))
    power = sum(np.sum(run**2, axis=0) for run in values)
    r = [sum(np.sum(run[k:] * run[:-k], axis=0) for run in values) / power for k in range(1, LAGS + 1)]
    m = len(values[0])
    assert np.allclose(three["Q"], 3 * sum(m * (m + 2) * rk**2 / (m - k) for k, rk in enumerate(r, 1)))
    assert np.allclose(three["p white"], stats.chi2.sf(three["Q"], LAGS))
    table = many.whiteness
    assert (table["mean"].abs() < 3.3 / 1.96 * table["mean ±"]).all()
    assert (table["p white"] > 1e-3 / 6).all()


def test_a_run_that_did_not_use_a_fix_has_a_gap_there() -> None:
    """Seeds whose fixes differ: the averages take those there are."""
    short = Experiment(mission="los_angeles")
    gap = Experiment(mission="los_angeles")
    gap.set("sensors.gps.outages", [[9.5, 12.5]])
    runs = [keep_values(short.run()), keep_values(gap.run())]
    for order in (runs, runs[::-1]):  # the epochs of the second run are new, or are not
        collected = Collected()
        for run in order:
            collected.add(1, run)
        both = collected.ensemble(short)
        missing = (both.time > 9.5) & (both.time < 12.5)
        assert both.at_fixes.count["nees"].tolist() == np.where(missing, 1, 2).tolist()
        assert np.array_equal(both.consistency.anees[missing], runs[0].nees[missing])
        assert np.allclose(both.consistency.anees[~missing], (runs[0].nees[~missing] + runs[1].nees) / 2)
    assert float(both.consistency.anees_high[missing][0]) == pytest.approx(stats.chi2.interval(0.95, 15)[1])
    assert both.coverage["within ±3σ [%]"].notna().all()


def test_seeds_may_be_named_and_progress_is_told() -> None:
    told: list[tuple[str, float]] = []
    ensemble = run_ensemble(
        Experiment(mission="los_angeles"), (9, 3), lambda what, done: told.append((what, done))
    )
    assert ensemble.seeds == (9, 3)
    assert [done for _, done in told] == [0.5, 1.0]
    first = re.fullmatch(r"1 of 2 runs, ([\d.e+]+) per second, (\d+) s left", told[0][0])
    assert first is not None
    assert float(first[2]) == pytest.approx(1 / float(first[1]), abs=0.6)
    assert told[1][0] == "2 of 2 runs"
    again = run_ensemble(Experiment(mission="los_angeles"), (3, 9), workers=1)
    assert np.array_equal(ensemble.mean_nees[::-1], again.mean_nees)


def test_the_runs_that_are_done_are_an_ensemble_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each count of runs there is one, with the very values of the whole."""
    monkeypatch.setattr(seeds_module, "SHOWN_EVERY", 0.0)
    parts: list[Ensemble] = []
    whole = run_ensemble(Experiment(mission="los_angeles"), 5, partial=parts.append)
    assert [len(part.seeds) for part in parts] == [2, 3, 4]
    for part in parts:
        count = len(part.seeds)
        assert part.seeds == whole.seeds[:count]
        assert np.array_equal(part.rms, whole.rms[:count])
        alone = run_ensemble(Experiment(mission="los_angeles"), count)
        assert part.consistency.identical(alone.consistency)
        assert part.errors.identical(alone.errors)


def test_who_is_told_of_the_progress_may_end_the_work() -> None:
    told: list[float] = []

    def enough(_what: str, done: float) -> None:
        told.append(done)
        raise InterruptedError

    with pytest.raises(InterruptedError):
        run_ensemble(Experiment(mission="los_angeles"), 50, enough)
    assert told == [0.02]


@pytest.mark.parametrize(("wanted", "abreast"), [(60, False), (150, True)])
def test_a_cancelled_ensemble_is_that_of_the_runs_that_were_begun(wanted: int, abreast: bool) -> None:
    experiment = Experiment(mission="los_angeles").update({"trajectory.imu_rate": 20.0})
    if abreast:  # whoever runs more than a hundred abreast has the filter compiled
        lanes = SeedLanes.of(experiment)
        assert lanes is not None
        list(lanes.measure((1,)))
    told: list[str] = []
    some = run_ensemble(
        experiment,
        wanted,
        lambda words, _done: told.append(words),
        workers=2,
        cancelled=lambda: len(told) > 3,
    )
    count = len(some.seeds)
    assert 3 < count < wanted
    assert some.seeds == tuple(range(1, 1 + count))
    whole = run_ensemble(experiment, wanted)
    assert np.array_equal(some.rms, whole.rms[:count])
    assert np.array_equal(some.mean_nis, whole.mean_nis[:count])
    with pytest.raises(StoppedError, match=f"before the first of {wanted} runs"):
        run_ensemble(experiment, wanted, cancelled=lambda: True)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ensemble")]


def test_its_file_has_the_figures_of_each_run_and_of_each_fix(many: Ensemble, tmp_path: Path) -> None:
    many.to_netcdf(tmp_path / "many.nc")
    with xr.open_datatree(tmp_path / "many.nc") as found:
        assert np.array_equal(found["runs"].seed, many.seeds)
        heading = found["runs"].rms.sel(quantity="attitude heading")
        assert np.array_equal(heading, many.rms[:, QUANTITIES.index("attitude heading")])
        assert str(heading.unit.values) == "°"
        assert np.array_equal(found["consistency"].anees, many.consistency.anees)
        assert np.array_equal(found["errors"].sigma, many.errors.sigma)
        assert found.attrs["title"] == f"{SEEDS} runs of los_angeles"
        assert Experiment.from_toml(found.attrs["settings"]).seed == 5
    with pytest.raises(FileExistsError, match="exists already"):
        many.to_netcdf(tmp_path / "many.nc")


@pytest.mark.parametrize("seeds", [[-1], range(2**32 - 1, 2**32 + 1)])
def test_seeds_that_no_experiment_accepts_are_refused_before_the_work(seeds: Sequence[int]) -> None:
    with pytest.raises(SettingError, match="accepted is a whole number from 0 to 4294967295"):
        run_ensemble(Experiment(), seeds)


@pytest.mark.parametrize("seeds", [0, -3, ()])
def test_no_seeds_are_refused(seeds: object) -> None:
    with pytest.raises(ValueError, match="contains no run; accepted is"):
        run_ensemble(Experiment(), seeds)  # type: ignore[arg-type]


@pytest.mark.parametrize("seeds", [1.5, "12", None, [1.5]])
def test_seeds_that_are_no_whole_numbers_are_refused(seeds: object) -> None:
    with pytest.raises(ValueError, match="no whole number; accepted is"):
        run_ensemble(Experiment(), seeds)  # type: ignore[arg-type]


def test_what_is_wrong_with_a_run_is_told_and_the_threads_end() -> None:
    wrong = Experiment(mission="los_angeles")
    wrong.set("navigator.r", [1, 1, 1, 0, 1, 1])
    with pytest.raises(SettingError, match=r"navigator\.r: is singular"):
        run_ensemble(wrong, 5)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ensemble")]


def test_runs_that_diverge_are_left_out_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Experiment.run

    def run_or_diverge(experiment: Experiment, *arguments: Any, **options: Any) -> Result:
        if experiment.seed % 2 == 0:
            raise divergence_error("the numbers are not usable from t = 3 s on")
        return run(experiment, *arguments, **options)

    monkeypatch.setattr(Experiment, "run", run_or_diverge)
    monkeypatch.setattr(seeds_module, "SHOWN_EVERY", 0.0)
    short = Experiment(mission="los_angeles").update({"trajectory": {"imu_rate": 50}})
    parts: list[Ensemble] = []
    found = run_ensemble(short, (2, 4, 1, 3), partial=parts.append, workers=1)
    assert found.seeds == (1, 3)
    assert [(part.seeds, list(part.diverged)) for part in parts] == [((1,), [2, 4])]
    assert "not usable from t = 3 s" in found.diverged[2]
    assert found.remark == "2 of 4 runs diverged, and are left out of all figures: seeds 2, 4."
    assert found.remark in repr(found)
    assert found.consistency.identical(run_ensemble(short, (1, 3)).consistency)
    with pytest.raises(DivergedError, match="not usable from"):
        run_ensemble(short, (2,))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_flights_without_fixes_give_no_figures_and_no_complaints() -> None:
    free = Experiment(mission="los_angeles")
    free.set("sensors.gps.outages", [[0, 1e6]])
    ensemble = run_ensemble(free, 2)
    assert ensemble.time.size == 0
    assert np.isnan(ensemble.inside()).all()
    assert ensemble.coverage["within ±3σ [%]"].isna().all()


@pytest.mark.proof
@pytest.mark.parametrize(
    "changes",
    [
        {"navigator.correction": "feedforward"},
        {"navigator.correction": "feedforward", "sensors.barometer.fitted": True},
        {"navigator.correction_period": 60.0},
    ],
    ids=["feedforward", "with a barometer", "seldom corrected"],
)
def test_a_navigator_that_runs_free_beyond_the_linear_model_is_the_cause(changes: dict[str, object]) -> None:
    """As for each run alone: nothing else can be judged, though the barometer is off by ten σ."""
    experiment = Experiment(mission="montreal").update({"trajectory.imu_rate": 20.0, **changes})
    many = run_ensemble(experiment, 3)
    (cause,) = experiment.copy().update({"seed": 2}).run().verdict.findings
    for verdict in (many.verdict, many.innovation_verdict, *many.verdicts):
        (finding,) = verdict.findings
        assert finding.quantity == cause.quantity
        assert finding.changes == cause.changes
    (farthest,) = many.verdict.findings
    assert farthest.factor == max(verdict.findings[0].factor for verdict in many.verdicts)
    assert "linear" in many.remark


@pytest.mark.proof
def test_a_few_runs_beyond_the_linear_model_do_not_hide_the_cause_of_the_others() -> None:
    """Fixes that are twice as noisy as assumed; a correction of five seconds is seldom too late."""
    changes = {"navigator.correction_period": 5.0, "navigator.r_scale": 0.5, "trajectory.imu_rate": 20.0}
    experiment = Experiment(mission="montreal").update(changes | {"sensors.gps.outages": [[10.0, 20.0]]})
    many = run_ensemble(experiment, 12)
    beyond = sum(free.excess > 1 for free in many.free)
    assert 0 < beyond < 6
    assert {finding.quantity for finding in many.verdict.findings} == {"R position", "R velocity"}
    assert "linear" in many.remark
