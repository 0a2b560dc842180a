"""Result: datasets against the arrays they stand for, and files against the datasets."""

from __future__ import annotations

import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest
import xarray as xr
from scipy import stats

from lab.experiment.experiment import Experiment
from lab.experiment.result import DATASETS, Result
from lab.experiment.simulated_result import SimulatedResult
from lab.missions import Recording, write_flight_csv


def southward() -> Recording:
    """Return a flight of 30 s over the southern ocean, heading south, where 180° turns into −180°."""
    time = np.arange(0, 30.05, 0.1)
    heading = np.pi + 0.02 * np.sin(time)
    velocity = 80 * np.stack((np.cos(heading), np.sin(heading), np.zeros_like(time)), axis=-1)
    steps = np.vstack((np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * 0.1, axis=0)))
    lat, lon, _ = pymap3d.ned2geodetic(steps[:, 0], steps[:, 1], 0 * time, -40.0, 100.0, 300.0)
    return Recording(
        time=time,
        latitude=np.radians(lat),
        longitude=np.radians(lon),
        height=np.full(time.size, 300.0),
        velocity_n=velocity,
        euler=np.stack((0.15 * np.cos(time), 0.03 + 0 * time, heading), axis=-1),
    )


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """Return the result of a short flight southwards."""
    path = tmp_path_factory.mktemp("flights") / "south.csv"
    write_flight_csv(path, southward())
    one = Experiment(mission=str(path), seed=3)
    one.set("sensors.gyro.instability", 30)
    one.set("sensors.gps.outages", [[12, 14]])
    one.set("sensors.accelerometer.bias", 3)
    return one.run()


def enu(estimate: xr.Dataset, truth: xr.Dataset) -> np.ndarray:
    """Return estimate minus truth in metres east, north, up by pymap3d."""
    where = [estimate[name].values for name in ("latitude", "longitude", "height")]
    there = [truth[name].values for name in ("latitude", "longitude", "height")]
    return np.stack(pymap3d.geodetic2enu(*where, *there), axis=-1)


# Datasets


def test_position_errors_are_estimate_minus_truth_east_north_up(result):
    assert np.allclose(result.errors.position.values, enu(result.solution, result.truth), atol=1e-5)
    assert result.errors.position.axis.values.tolist() == ["east", "north", "up"]
    assert np.abs(result.errors.position.values).max() > 0.5


def test_velocity_errors_are_estimate_minus_truth(result):
    difference = result.solution.velocity.values - result.truth.velocity.values
    assert np.allclose(result.errors.velocity.values, difference, atol=1e-12)
    north = result.truth.velocity.sel(axis="north").values
    assert north.mean() == pytest.approx(-80, abs=0.1)


def test_heading_errors_are_wrapped(result):
    raw = (result.solution.attitude - result.truth.attitude).sel(angle="heading").values
    assert np.abs(raw).max() > 300, "the flight crosses ±180°"
    heading = result.errors.attitude.sel(angle="heading").values
    assert np.abs(heading).max() < 10
    assert np.allclose(np.exp(1j * np.radians(heading)), np.exp(1j * np.radians(raw)), atol=1e-12)


def test_truth_is_the_recorded_flight(result):
    recording = southward()
    at = np.round(recording.time * 200).astype(int)
    assert np.allclose(result.truth.latitude.values[at], np.degrees(recording.latitude), atol=1e-5)
    assert np.allclose(result.truth.height.values[at], 300, atol=0.2)
    roll = result.truth.attitude.sel(angle="roll").values[at]
    assert np.allclose(roll, np.degrees(recording.euler[:, 0]), atol=1e-6)


def test_errors_keep_to_their_sigma(result):
    """99.9 % of a normal error is inside 3.3 σ; here with room for what a single run holds."""
    for name in ("position", "velocity", "attitude"):
        ratio = result.errors[name].values / result.sigma[name].values
        assert 0.1 < np.sqrt(np.mean(ratio**2)) < 2.5
        assert np.abs(ratio).max() < 6


def test_sigmas_belong_to_east_north_up(result):
    """A receiver good in the east, fair in the north and poor in height leaves its order in every σ."""
    one = result.experiment.copy()
    one.set("sensors.gps.position_variance", (0.1, 1, 10))
    one.set("sensors.gps.velocity_variance", (0.01, 0.1, 1))
    uneven = one.run()
    for name in ("position", "velocity"):
        end = uneven.sigma[name].values[-1]
        innovation = uneven.innovations[f"{name}_sigma"].values[-1]
        assert (np.diff(end) > 0.1 * end[:2]).all()
        assert (np.diff(innovation) > innovation[:2]).all()
    assert np.allclose(uneven.sigma.position[0], 1)
    spread = uneven.gps.velocity_error.values.std(axis=0)
    assert (np.diff(spread) > spread[:2]).all()


def test_sigma_of_the_states_in_their_units(result):
    states = result.state_sigma.sigma
    units = dict(zip(states.state.values, states.unit.values, strict=True))
    assert units["position north"] == "m"
    assert units["gyro bias x"] == "°/s"
    first = states.isel(time=0)
    expected = {"position north": 1, "velocity down": 0.3, "attitude north": 0.5, "attitude down": 2}
    for state, sigma in expected.items():
        assert float(first.sel(state=state)) == pytest.approx(sigma)
    # Turn-on bias 0.1 °/s and instability 30 °/h; 2 mg drawn beside 3 mg given.
    assert float(first.sel(state="gyro bias x")) == pytest.approx(np.hypot(0.1, 30 / 3600))
    assert float(first.sel(state="accelerometer bias z")) == pytest.approx(np.hypot(2, 3))
    assert np.allclose(states.sel(state="position east"), result.sigma.position.sel(axis="east"))


def test_measured_minus_true_imu_is_bias_and_noise(result):
    imu, truth = result.imu, result.sensor_errors
    gyro = imu.angular_rate.values - imu.angular_rate_true.values - truth.gyro_bias_true.values[1:]
    assert np.std(gyro) == pytest.approx(0.05 * np.sqrt(200), rel=5 / np.sqrt(2 * gyro.size))
    force = imu.specific_force.values - imu.specific_force_true.values
    force -= truth.accelerometer_bias_true.values[1:] * 9.80665e-3
    assert np.allclose(np.std(force, axis=0) / (9.80665e-6 * np.sqrt(200)), (35, 65, 35), rtol=0.05)
    assert imu.specific_force_true.sel(body_axis="z").mean() == pytest.approx(-9.8, abs=0.3)


def test_estimated_biases_come_nearer_to_the_true_ones(result):
    biases = result.sensor_errors
    miss = np.abs(biases.gyro_bias - biases.gyro_bias_true).mean("body_axis").values
    assert miss[-1] < 0.5 * miss[0]
    assert (biases.gyro_bias_sigma.values[-1] < biases.gyro_bias_sigma.values[0]).all()


def test_gps_fixes_and_their_errors(result):
    truth = result.truth.interp(time=result.gps.time_gps)
    assert np.allclose(result.gps.position_error.values, enu(result.gps, truth), atol=1e-3)
    difference = result.gps.velocity.values - truth.velocity.values
    assert np.allclose(result.gps.velocity_error.values, difference, atol=1e-3)
    assert result.gps.time_gps.values.tolist() == [t for t in range(1, 31) if not 12 <= t <= 14]


def test_innovations_are_navigator_minus_gps(result):
    """Before a fix is used the navigator is one sample's motion from where it was a sample ago."""
    before = result.solution.sel(time=result.gps.time_gps.values - 0.005, method="nearest")
    moved = result.solution.velocity.sel(time=before.time).values * 0.005
    expected = enu(before, result.gps) + moved
    assert np.allclose(result.innovations.position.values, expected, atol=5e-3)
    assert np.abs(result.innovations.position.values).max() > 0.5


def test_nis_and_nees_are_of_the_size_of_their_degrees(result):
    for values, degrees in ((result.innovations.nis, 6), (result.consistency.nees, 15)):
        low, high = stats.chi2.interval(0.9999, degrees * values.size)
        assert 0.5 * low < float(values.sum()) < 2 * high
    assert result.consistency.nees.attrs["degrees"] == 15


def test_autocorrelation_and_its_band(result):
    assert np.allclose(result.autocorrelation.position.sel(lag=0), 1)
    assert result.autocorrelation.sizes["lag"] == 27
    assert result.autocorrelation.attrs["band"] == pytest.approx(1.96 / np.sqrt(27), rel=1e-3)


def test_track_is_in_metres_on_the_map(result):
    north = result.track.northing.sel(path="true").values
    east = result.track.easting.sel(path="true").values
    # Meridian convergence and the scale of UTM are within a percent here.
    assert north[-1] - north[0] == pytest.approx(-80 * 30, rel=0.01)
    difference = result.track.easting.sel(path="estimated").values - east
    assert np.allclose(difference, result.errors.position.sel(axis="east"), atol=0.1)
    assert "UTM zone 47 south" in result.track.easting.attrs["long_name"]


def test_position_covariance_agrees_with_sigma_after_each_fix(result):
    diagonal = np.diagonal(result.position_covariance.values, axis1=1, axis2=2)
    sigma = result.sigma.position.sel(time=result.gps.time_gps, method="nearest").values
    assert np.allclose(np.sqrt(diagonal), sigma, rtol=1e-9)


def test_summary_is_rms_largest_and_95_percent(result):
    table = result.summary.set_index("quantity")
    assert list(table.columns) == ["unit", "rms", "max", "95 %"]
    assert len(table) == 9
    for quantity, unit in (("position up", "m"), ("velocity east", "m/s"), ("attitude heading", "°")):
        kind, component = quantity.split()
        array = result.errors[kind]
        size = sorted(abs(float(x)) for x in array.sel({array.dims[1]: component}))
        row = table.loc[quantity]
        assert row["unit"] == unit
        assert row["rms"] == pytest.approx(np.sqrt(np.mean(np.square(size))))
        assert row["max"] == size[-1]
        assert row["95 %"] == pytest.approx(size[round(0.95 * (len(size) - 1))], rel=1e-2)


def test_every_dataset_has_units_and_long_names(result):
    for name, dataset in result.datasets().items():
        for array in dataset.data_vars.values():
            assert "units" in array.attrs, (name, array.name)
            assert array.attrs["long_name"], (name, array.name)


def test_a_simulated_run_lacks_nothing(result):
    assert isinstance(result, SimulatedResult)
    assert not any(map(result.missing_reason, (*DATASETS, "summary", "coverage", "budget")))
    assert (result.truth_word, result.realisation, result.epoch) == ("truth", "seed 3", 0.0)
    assert result.recorded is None


def test_threads_that_ask_at_once_get_the_same(result):
    with ThreadPoolExecutor(8) as pool:
        tables = list(pool.map(lambda _: result.innovations, range(16)))
    assert all(table.equals(tables[0]) for table in tables)


# Files


def test_netcdf_gives_the_same_datasets_back(result, tmp_path):
    path = tmp_path / "run.nc"
    result.to_netcdf(path)
    with xr.open_datatree(path) as tree:
        assert set(tree.children) == set(DATASETS)
        for name, dataset in result.datasets().items():
            read = tree[name].to_dataset()
            xr.testing.assert_identical(read.load(), dataset)
        settings = tomllib.loads(tree.attrs["settings"])
    assert settings == tomllib.loads(result.experiment.to_toml())
    assert [file.name for file in tmp_path.iterdir()] == ["run.nc"], "nothing else is left behind"


@pytest.mark.proof
def test_temperature_and_thermometer_are_there_where_a_profile_is_set(result, tmp_path):
    assert "temperature" not in result.datasets()
    experiment = Experiment(mission="los_angeles")
    experiment.set("sensors.temperature.profile", "warm_up")
    experiment.set("sensors.temperature.start", 10)
    experiment.set("sensors.temperature.thermometer_sigma", 0.5)
    warm = experiment.run()
    found = warm.temperature
    assert np.allclose(found.true, 10 + 20 * (1 - np.exp(-found.time_imu / 300)), rtol=0, atol=1e-9)
    assert found.true.attrs["units"] == found.reading.attrs["units"] == "°C"
    noise = (found.reading - found.true).values
    assert np.std(noise) == pytest.approx(0.5, rel=5 / np.sqrt(2 * noise.size))
    warm.to_csv(tmp_path / "csv")
    table = pd.read_csv(tmp_path / "csv" / "temperature.csv")
    assert np.allclose(table["reading [°C]"], found.reading, atol=1e-6)
    warm.to_netcdf(tmp_path / "run.nc")
    with xr.open_datatree(tmp_path / "run.nc") as tree:
        xr.testing.assert_identical(tree["temperature"].to_dataset().load(), found)


def test_netcdf_refuses_to_overwrite(result, tmp_path):
    path = tmp_path / "run.nc"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match=r"run\.nc exists already"):
        result.to_netcdf(path)
    assert path.read_text() == "mine"
    result.to_netcdf(path, overwrite=True)
    with xr.open_datatree(path) as tree:
        assert "errors" in tree.children


def test_netcdf_names_a_folder_that_is_not_there(result, tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        result.to_netcdf(tmp_path / "no" / "run.nc")


def test_csv_gives_the_same_numbers_back_under_their_units(result, tmp_path):
    folder = tmp_path / "run"
    result.to_csv(folder)
    assert {path.name for path in folder.iterdir()} == {
        *(f"{name}.csv" for name in DATASETS),
        "summary.csv",
        "settings.toml",
    }
    errors = pd.read_csv(folder / "errors.csv")
    assert np.allclose(errors["time [s]"], result.time)
    assert np.allclose(errors["position north [m]"], result.errors.position.sel(axis="north"), atol=1e-9)
    assert np.allclose(errors["attitude heading [°]"], result.errors.attitude.sel(angle="heading"), atol=1e-9)
    truth = pd.read_csv(folder / "truth.csv")
    # 1e-9° is a tenth of a millimetre.
    assert np.allclose(truth["longitude [°]"], result.truth.longitude, rtol=0, atol=1e-9)
    states = pd.read_csv(folder / "state_sigma.csv")
    bias = result.state_sigma.sigma.sel(state="gyro bias y")
    assert np.allclose(states["sigma gyro bias y [°/s]"], bias, atol=1e-9)
    track = pd.read_csv(folder / "track.csv")
    assert np.allclose(track["northing true [m]"], result.track.northing.sel(path="true"), rtol=0, atol=1e-4)
    assert pd.read_csv(folder / "autocorrelation.csv")["lag"].tolist() == list(range(27))
    summary = pd.read_csv(folder / "summary.csv")
    assert np.allclose(summary["rms"], result.summary["rms"], rtol=1e-5)
    assert Experiment.from_toml(folder / "settings.toml").to_dict() == result.experiment.to_dict()


def test_csv_refuses_to_overwrite_and_then_writes_nothing(result, tmp_path):
    (tmp_path / "gps.csv").write_text("mine")
    with pytest.raises(FileExistsError, match=r"gps\.csv exists already"):
        result.to_csv(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["gps.csv"]
    result.to_csv(tmp_path, overwrite=True)
    assert (tmp_path / "gps.csv").read_text() != "mine"


# Shown


def test_a_notebook_shows_what_was_run_and_the_errors(result):
    page = result._repr_html_().replace("<wbr>", "")
    for words in (
        Path(result.mission.name).name,
        "30 s",
        "seed 3",
        "sensors.gps.outages",
        "position east",
        "rms",
    ):
        assert words in page
    # Colours are the notebook's own, light or dark.
    assert "color" not in page
    assert "background" not in page


def test_a_terminal_shows_the_errors(result):
    text = repr(result)
    assert "seed 3" in text
    assert all(f"position {axis}" in text for axis in ("east", "north", "up"))
    assert len(text) < 1500
