"""Sweep: numbers of single runs, a cache that computes nothing twice, errors that name the setting."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from sensor_logs import tables, write

from lab.base.parameters.setting_error import SettingError
from lab.base.progress import StoppedError
from lab.experiment.ensembles import sweeping
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.ensembles.swept_values import name_dimension
from lab.experiment.experiment import Experiment
from lab.experiment.sweep import Sweep
from lab.missions import MissionError
from lab.navigation.belief import FAST_RATE
from lab.sensors.cards import card

DENSITIES = [0.3, 0.02]
SEEDS = 3


def small() -> Experiment:
    experiment = Experiment(mission="los_angeles", seed=4)
    experiment.trajectory.imu_rate = 20
    return experiment


@pytest.fixture(scope="module")
def swept() -> Iterator[Sweep]:
    sweeping.KEPT.clear()
    yield small().sweep({"sensors.gyro.noise_density": DENSITIES, "navigator.r_scale": [1.0, 0.1]}, SEEDS)
    sweeping.KEPT.clear()


def test_each_number_is_that_of_the_run_alone(swept: Sweep) -> None:
    alone = small()
    alone.update({"seed": 6, "sensors": {"gyro": {"noise_density": 0.02}}, "navigator": {"r_scale": 0.1}})
    result = alone.run()
    at = swept.dataset.sel(noise_density=0.02, r_scale=0.1, seed=6)
    assert np.allclose(at.rms, result.summary["rms"], rtol=1e-12)
    assert np.allclose(at["max"], result.summary["max"], rtol=1e-12)
    heading = float(np.sqrt((result.sigma.attitude.sel(angle="heading") ** 2).mean()))
    assert float(at.sigma.sel(quantity="attitude heading")) == pytest.approx(heading, rel=1e-12)
    assert float(at.nees) == pytest.approx(float(result.consistency.nees.mean()), rel=1e-12)
    assert float(at.nis) == pytest.approx(float(result.innovations.nis.mean()), rel=1e-12)
    assert float(at.nees_degrees) == 15


def test_it_agrees_with_an_ensemble_and_has_dimensions_with_units(swept: Sweep) -> None:
    experiment = small()
    experiment.set("sensors.gyro.noise_density", 0.3)
    ensemble = run_ensemble(experiment, SEEDS)
    there = swept.dataset.sel(noise_density=0.3, r_scale=1.0)
    assert np.allclose(there.rms, ensemble.rms)
    assert swept.dims == ("noise_density", "r_scale")
    assert swept.dataset.rms.dims == ("noise_density", "r_scale", "seed", "quantity")
    assert swept.dataset.noise_density.attrs["units"] == "°/s/√Hz"
    assert swept.dataset.noise_density.values.tolist() == DENSITIES
    assert swept.dataset.seed.values.tolist() == [4, 5, 6]
    assert swept.dataset.unit.values.tolist() == ["m"] * 3 + ["m/s"] * 3 + ["°"] * 3


def test_nothing_is_computed_twice_and_an_interrupted_sweep_goes_on(
    swept: Sweep, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[int] = []
    run = sweeping.run
    stopped = threading.Event()
    stopped.set()

    def counted(point: Experiment, seed: int) -> sweeping.Numbers:
        # The second run does not end before the sweep is interrupted.
        assert len(runs) != 1 or stopped.wait(60)
        runs.append(seed)
        return run(point, seed)

    monkeypatch.setattr(sweeping, "run", counted)
    monkeypatch.setattr(sweeping, "REPORT_EVERY", 0.0)
    wider = {"sensors.gyro.noise_density": [*DENSITIES, 0.1], "navigator.r_scale": [1.0, 0.1]}
    small().sweep(wider, SEEDS)
    assert sorted(runs) == [4, 4, 5, 5, 6, 6]

    def stop(_words: str, _fraction: float) -> None:
        stopped.set()
        raise KeyboardInterrupt

    runs.clear()
    stopped.clear()
    with pytest.raises(KeyboardInterrupt):
        small().sweep({"sensors.gps.period": [1.0, 2.0]}, 4, stop, workers=1)
    assert len(runs) < 8
    told: list[float] = []
    small().sweep({"sensors.gps.period": [1.0, 2.0]}, 4, lambda _words, done: told.append(done), workers=1)
    assert len(runs) == 8
    assert told[-1] == 1.0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "no setting named"),
        ({"sensors.gyro.noise": [1]}, "no setting 'noise' in sensors.gyro. Did you mean"),
        ({"sensors.gyro.noise_density": [0.1, 99]}, "99: not accepted.* from 0 to 10 °/s/√Hz"),
        ({"sensors.gyro.noise_density": 0.1}, "is one value; accepted is a list"),
        ({"navigator.model": "phi"}, "is one value; accepted is a list"),
        ({"sensors.gps.period": []}, "no value in the list"),
        ({"sensors.gps.period": [1, 1.0]}, "in the list twice"),
        ({"seed": [1, 2]}, "give their number or a list as `seeds`"),
        ({1: [0.1]}, "1 is no name of a setting"),
        ({"card": ["STIM301"]}, "there is no card 'STIM301'. Did you mean STIM300"),
        ({"card": ["STIM300", "stim300"]}, "card: 'STIM300' is in the list twice"),
        ({"card": [3]}, "3 is no card; accepted is a card, or its name"),
        (
            {"sensors.gyro.noise_density": [0.1], "sensors.gyro.noise_variance": [0.1]},
            "are two forms of one setting; accepted is one of them",
        ),
    ],
)
def test_an_error_names_the_setting_its_unit_and_its_bounds(settings: dict[Any, Any], words: str) -> None:
    with pytest.raises(SettingError, match=words):
        small().sweep(settings)
    with pytest.raises(ValueError, match="contains no run"):
        small().sweep({"sensors.gps.period": [1]}, 0)


@pytest.mark.parametrize("seeds", [1.5, "12", [1, 2.5], [None], None])
def test_seeds_that_are_no_whole_numbers_are_refused(seeds: Any) -> None:
    with pytest.raises(ValueError, match=r"seeds: .* no whole number; accepted is a number from 1"):
        small().sweep({"sensors.gps.period": [1]}, seeds)


@pytest.mark.parametrize("workers", [0, -1, 1.5, float("nan"), "two"])
def test_a_number_of_threads_that_is_none_is_refused(workers: Any) -> None:
    words = "accepted is a whole number from 1"
    with pytest.raises(ValueError, match=words):
        small().sweep({"sensors.gps.period": [1.0, 2.0]}, 2, workers=workers)
    with pytest.raises(ValueError, match=words):
        run_ensemble(small(), 2, workers=workers)


def test_runs_that_the_settings_forbid_are_missing_with_the_reason() -> None:
    some = small().sweep({"navigator.model": ["phi", "nonlinear"], "navigator.smoother": [True]}, 1)
    (reason,) = some.refused
    assert reason.startswith("1 of 2 runs: ")
    assert "smoother" in reason
    assert np.isnan(some.dataset.rms.sel(model="nonlinear")).all()
    assert np.isfinite(some.dataset.rms.sel(model="phi")).all()
    assert "smoother" in str(some._repr_html_())
    with pytest.raises(ValueError, match="No run of the sweep is possible"):
        small().sweep({"navigator.model": ["nonlinear"], "navigator.smoother": [True]}, 1)


def test_a_sensor_log_is_swept_with_one_run_and_its_errors_may_be_unknown(tmp_path: Path) -> None:
    folder = write(tmp_path / "drive", tables(60, 100))
    (folder / "ref.csv").unlink()
    experiment = Experiment(mission=str(folder))
    with pytest.raises(ValueError, match="accepted is seeds=1"):
        experiment.sweep({"navigator.r_scale": [1.0, 0.1]})
    data = experiment.sweep({"navigator.r_scale": [1.0, 0.1]}, 1).dataset
    assert np.isnan(data.rms).all()
    assert np.isnan(data.nees).all()
    assert (data.sigma > 0).all()
    assert float(data.nis.sel(r_scale=0.1).mean()) > float(data.nis.sel(r_scale=1.0).mean())


def test_two_settings_with_the_same_name_have_dimensions_of_their_own() -> None:
    paths = ["sensors.gyro.bias", "sensors.accelerometer.bias", "sensors.gps.period"]
    assert [name_dimension(path, dict.fromkeys(paths)) for path in paths] == [
        "gyro_bias",
        "accelerometer_bias",
        "period",
    ]


def test_the_plot_shows_the_mean_of_the_runs_with_their_band(swept: Sweep) -> None:
    first = next(iter(swept.sel(r_scale=1.0).plot(["attitude heading"])))
    heading = swept.dataset.rms.sel(r_scale=1.0, quantity="attitude heading").sortby("noise_density")
    area, _, curve, _ = first
    assert np.allclose(curve.dimension_values(0), sorted(DENSITIES))
    assert np.allclose(curve.dimension_values(1), np.sqrt((heading**2).mean("seed")))
    low, high = (area.dimension_values(column) for column in (1, 2))
    assert (low < curve.dimension_values(1)).all()
    assert np.allclose(high, heading.quantile(0.95, "seed"))
    assert len(swept.plot()) == 5
    with pytest.raises(ValueError, match="no quantity 'speed'; accepted are position"):
        swept.plot(["speed"])
    with pytest.raises(ValueError, match="0 settings vary"):
        swept.sel(r_scale=1.0, noise_density=0.3).plot()


def test_a_swept_card_is_the_card_loaded_and_other_settings_override_it() -> None:
    experiment = small()
    experiment.sensors.gyro.noise_density = 7.0  # the card replaces it
    # The card is loaded first, although it comes last here.
    swept = experiment.sweep({"navigator.alignment": [10.0, 12.0], "card": ["BMI270", card("STIM300")]}, 1)
    assert swept.dims == ("alignment", "card")
    assert swept.dataset.card.values.tolist() == ["BMI270", "STIM300"]
    assert swept.dataset.card.attrs == {"units": "", "long_name": "Card", "setting": "card"}
    alone = small()
    card("STIM300").load(alone)
    alone.navigator.alignment = 12.0
    there = swept.dataset.sel(card="STIM300", alignment=12.0, seed=4)
    assert np.allclose(there.rms, alone.run().summary["rms"], rtol=1e-12)
    assert float(there.nees_degrees) == 36


def test_missions_are_swept_like_settings() -> None:
    swept = small().sweep({"mission": ["montreal", "los_angeles"], "navigator.r_scale": [1.0, 0.1]}, 1)
    assert swept.mission == swept.dataset.attrs["mission"] == "montreal, los_angeles"
    other = small()
    other.update({"mission": "montreal", "navigator": {"r_scale": 0.1}})
    there = swept.dataset.sel(mission="montreal", r_scale=0.1, seed=4)
    assert np.allclose(there.rms, other.run().summary["rms"], rtol=1e-12)
    assert "montreal, los_angeles" in str(swept._repr_html_())
    with pytest.raises(MissionError, match="Did you mean montreal"):
        small().sweep({"mission": ["los_angeles", "montrael"]}, 1)


def test_a_fast_sweep_is_one_with_the_fast_rate() -> None:
    values = {"navigator.q_scale": [1.0, 0.1]}
    experiment = small()
    experiment.trajectory.imu_rate = 50
    fast = experiment.sweep(values, 1, fast=True).dataset
    experiment.navigator.filter_rate = FAST_RATE
    assert fast.equals(experiment.sweep(values, 1).dataset)
    experiment.navigator.filter_rate = 0.0
    assert not fast.equals(experiment.sweep(values, 1).dataset)
    smoothed = {"navigator.smoother": [True]}
    assert experiment.sweep(smoothed, 1, fast=True).dataset.equals(experiment.sweep(smoothed, 1).dataset)
    with pytest.raises(SettingError, match=r"navigator\.filter_rate: is swept; accepted without fast"):
        experiment.sweep({"navigator.filter_rate": [10.0, 20.0]}, 1, fast=True)


def test_a_large_sweep_runs_seeds_abreast_where_an_ensemble_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its numbers are those of runs alone; a smoothed run is alone, and a point that is refused says why."""
    experiment = small()
    experiment.trajectory.imu_rate = 50
    values = {"navigator.smoother": [False, True], "navigator.model": ["phi", "nonlinear"]}
    sweeping.KEPT.clear()
    alone = experiment.sweep(values, 3)
    abreast: list[tuple[int, ...]] = []
    figures = SeedLanes.figures

    def counted(self: SeedLanes, seeds: tuple[int, ...]) -> Iterator[Any]:
        abreast.append(seeds)
        return figures(self, seeds)

    monkeypatch.setattr(SeedLanes, "figures", counted)
    for limit in ("FEW", "MANY"):
        monkeypatch.setattr(sweeping, limit, 12)
    sweeping.KEPT.clear()
    some = experiment.sweep(values, 3)
    assert abreast == [(4, 5, 6)]
    assert some.refused == alone.refused
    for name in alone.dataset.data_vars:
        np.testing.assert_allclose(some.dataset[name], alone.dataset[name], rtol=1e-7)
    # What is in the cache is not done again, and the rest does not depend on it.
    abreast.clear()
    more = experiment.sweep(values, 5)
    assert abreast == [(7, 8)]
    sweeping.KEPT.clear()
    again = experiment.sweep(values, 5).dataset.isel(smoother=0, model=0)
    assert again.equals(more.dataset.isel(smoother=0, model=0))


def test_a_cancelled_sweep_has_the_runs_that_were_begun_and_says_so(tmp_path: Path) -> None:
    sweeping.KEPT.clear()
    done: list[float] = []

    def tell(_words: str, fraction: float) -> None:
        done.append(fraction)

    values = {"card": ["BMI270", "STIM300"], "navigator.q_scale": [1.0, 0.1]}
    whole = small().sweep(values, 3)
    sweeping.KEPT.clear()
    some = sweeping.sweep(small(), values, 3, tell, 1, cancelled=lambda: bool(done))
    known = np.isfinite(some.dataset.nis).values
    assert 0 < known.sum() < known.size == 12
    assert some.missing == 12 - known.sum()
    assert some.refused == (f"{some.missing} of 12 runs: not done, because the sweep was stopped",)
    assert np.array_equal(some.dataset.rms.values[known], whole.dataset.rms.values[known])
    assert np.isnan(some.dataset.rms.values[~known]).all()
    # What is missing disturbs neither plot nor card nor file.
    assert len(some.plot()) == 5
    assert "the sweep was stopped" in str(some._repr_html_())
    some.to_csv(tmp_path / "some.csv")
    table = pd.read_csv(tmp_path / "some.csv", comment="#")
    assert table["nis"].isna().sum() == some.missing
    sweeping.KEPT.clear()
    with pytest.raises(StoppedError, match="before the first of 12 runs"):
        sweeping.sweep(small(), values, 3, None, 1, cancelled=lambda: True)


def test_files_of_a_sweep_hold_every_run_with_units(swept: Sweep, tmp_path: Path) -> None:
    swept.to_netcdf(tmp_path / "sweep.nc")
    with xr.open_dataset(tmp_path / "sweep.nc") as found:
        assert found.drop_attrs().equals(swept.dataset.drop_attrs())
        assert found.noise_density.attrs["units"] == "°/s/√Hz"
        assert found.rms.attrs["units"] == "m, m/s, °"
        assert Experiment.from_toml(found.attrs["settings"]).to_dict() == small().to_dict()
    swept.to_csv(tmp_path / "sweep.csv")
    table = pd.read_csv(tmp_path / "sweep.csv", comment="#")
    assert table.shape == (2 * 2 * SEEDS, 3 + 3 * 9 + 5)
    row = table[(table["noise_density [°/s/√Hz]"] == 0.02) & (table["r_scale"] == 0.1) & (table["seed"] == 6)]
    there = swept.dataset.sel(noise_density=0.02, r_scale=0.1, seed=6)
    heading = float(there.rms.sel(quantity="attitude heading"))
    assert float(row["rms attitude heading [°]"].iloc[0]) == pytest.approx(heading, rel=1e-11)
    assert float(row["horizontal_95 [m]"].iloc[0]) == pytest.approx(float(there.horizontal_95), rel=1e-11)
    for again, name in ((swept.to_netcdf, "sweep.nc"), (swept.to_csv, "sweep.csv")):
        with pytest.raises(FileExistsError, match="exists already"):
            again(tmp_path / name)


def test_no_line_joins_cards_in_the_plot() -> None:
    swept = small().sweep({"card": ["STIM300", "BMI270"], "navigator.q_scale": [1.0, 0.1]}, 2)
    for one in swept.plot():
        assert not one.traverse(lambda element: element, [hv.Curve, hv.Area])
        assert len(one.traverse(lambda element: element, [hv.Segments])) == 2
    position = next(iter(swept.plot(["position"])))
    first = position.traverse(lambda element: element, [hv.Scatter])[1]
    rms = (swept.dataset.rms.sel(q_scale=0.1)[..., :3] ** 2).sum("quantity").mean("seed") ** 0.5
    assert np.allclose(first.dimension_values(1), rms)
