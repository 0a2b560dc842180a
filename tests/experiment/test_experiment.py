"""Experiment: stages, same bits for same settings, TOML, and settings at their extremes."""

from __future__ import annotations

import hashlib
import pickle
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pymap3d
import pytest

from lab.base.files.mission_error import MissionError
from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE, start
from lab.missions import Recording, mission, write_flight_csv
from lab.motion.truth.trajectory import Trajectory
from lab.navigation.settings import NavigatorSettings
from lab.sensors.draws import unit_draws

STAGES = {"flight", "draws", "gyro", "accelerometer", "truth at fixes", "gps", "navigation"}


def recording(seconds: float, latitude: float = 45.0, heading: float = 30.0, north: float = 0.0) -> Recording:
    """Return a level flight at 60 m/s that begins `north` metres north of a latitude and weaves gently."""
    time = np.arange(0, seconds + 0.05, 0.1)
    heading = np.radians(heading)
    course = heading + 0.1 * np.sin(0.3 * time)
    speed = 60 * np.stack((np.cos(course), np.sin(course), np.zeros_like(time)), axis=-1)
    steps = np.vstack((np.zeros((1, 3)), np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.1, axis=0)))
    lat, lon, _ = pymap3d.ned2geodetic(steps[:, 0] + north, steps[:, 1], 0 * time, latitude, 9.0, 500.0)
    return Recording(
        time=time,
        latitude=np.radians(lat),
        longitude=np.radians(lon),
        height=np.full(time.size, 500.0),
        velocity_n=speed,
        euler=np.stack((0.18 * np.cos(0.3 * time), 0.02 + 0 * time, course), axis=-1),
    )


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the path of a flight of 20 s."""
    path = tmp_path_factory.mktemp("flights") / "short.csv"
    write_flight_csv(path, recording(20))
    return str(path)


@pytest.fixture(autouse=True)
def empty_cache() -> None:
    """Begin every test with nothing computed."""
    CACHE.clear()


def run(flight: str, **settings: object) -> Result:
    """Run an experiment; settings by their path, dots written as two underscores."""
    return experiment(flight, **settings).run()


def experiment(flight: str, **settings: object) -> Experiment:
    """Return an experiment; settings by their path, dots written as two underscores."""
    one = Experiment(mission=flight)
    for name, value in settings.items():
        one.set(name.replace("__", "."), value)
    return one


def bits(result: Result) -> str:
    """Return a digest of all bits of a solution."""
    return hashlib.sha256(
        b"".join(np.ascontiguousarray(part).tobytes() for part in result.solution_arrays)
    ).hexdigest()


def usable(result: Result) -> None:
    """Assert that a result holds numbers throughout and can be shown."""
    for dataset in result.datasets().values():
        for array in dataset.data_vars.values():
            assert np.isfinite(array.values).all(), array.name
    assert np.isfinite(result.summary[["rms", "max", "95 %"]].to_numpy()).all()
    assert result._repr_html_()
    assert repr(result)


# Stages


def recomputed(base: Experiment, path: str, value: object) -> set[str]:
    """Return which stages a change of one setting computes again."""
    base.run()
    before = dict(CACHE.computed)
    base.set(path, value)
    base.run()
    return {stage for stage, count in CACHE.computed.items() if count > before.get(stage, 0)}


@pytest.mark.parametrize(
    ("path", "value", "stages"),
    [
        ("navigator.r_scale", 2, {"navigation"}),
        ("navigator.r", [1.0] * 6, {"navigation"}),
        ("navigator.correction", "feedforward", {"navigation"}),
        ("navigator.position_sigma", 3, {"navigation"}),
        ("sensors.gyro.noise_density", 0.02, {"gyro", "navigation"}),
        ("sensors.gyro.instability", 20, {"draws", "gyro", "navigation"}),
        ("sensors.accelerometer.bias", 5, {"accelerometer", "navigation"}),
        ("sensors.gps.position_variance", 1, {"gps", "navigation"}),
        ("sensors.gps.outages", [[3, 5]], {"gps", "navigation"}),
        ("sensors.gps.period", 2, {"truth at fixes", "gps", "navigation"}),
        ("seed", 2, {"draws", "gyro", "accelerometer", "gps", "navigation"}),
        ("trajectory.imu_rate", 100, STAGES),
    ],
)
def test_a_change_recomputes_what_depends_on_it_and_nothing_else(short, path, value, stages):
    assert recomputed(experiment(short), path, value) == stages


def test_the_same_settings_compute_nothing_again(short):
    first = run(short)
    before = dict(CACHE.computed)
    assert run(short).solution_arrays is first.solution_arrays
    assert before == CACHE.computed
    assert set(before) == STAGES | {"recording"}


def test_another_flight_under_the_same_name_is_read_anew(tmp_path):
    path = tmp_path / "flight.csv"
    write_flight_csv(path, recording(5))
    assert run(str(path)).time[-1] == pytest.approx(5)
    write_flight_csv(path, recording(6))
    assert run(str(path)).time[-1] == pytest.approx(6)


def test_a_change_after_the_run_does_not_touch_the_result(short):
    one = experiment(short)
    result = one.run()
    one.set("sensors.gyro.noise_density", 5)
    assert result.experiment.sensors.gyro.noise_density == (0.05, 0.05, 0.05)


def test_the_trajectory_counts_its_memory_honestly(short):
    """Against the size of everything in it, written out."""
    for curve in ("rotation", "euler"):
        trajectory = Trajectory.from_recording(mission(short).recording, 200, curve)
        assert trajectory.nbytes == pytest.approx(len(pickle.dumps(trajectory)), rel=0.15)


# Same bits


def test_the_same_settings_and_seed_give_the_same_bits_in_threads(short):
    first = bits(run(short))
    for _ in range(2):
        CACHE.clear()
        with ThreadPoolExecutor(4) as pool:
            assert set(pool.map(lambda _: bits(run(short)), range(4))) == {first}
        assert CACHE.computed["navigation"] == 1
    CACHE.clear()
    assert bits(run(short, seed=2)) != first


@pytest.mark.proof
def test_the_same_settings_and_seed_give_the_same_bits_in_another_process(short):
    code = (
        "import hashlib, sys, numpy as np; from lab import Experiment; "
        "parts = Experiment(mission=sys.argv[1]).run().solution_arrays; "
        "print(hashlib.sha256(b''.join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest())"
    )
    other = subprocess.run([sys.executable, "-c", code, short], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == bits(run(short))


def test_the_initial_error_is_drawn_from_the_initial_sigma(short):
    truth = run(short).truth_arrays
    settings = NavigatorSettings(position_sigma=(1, 2, 4), velocity_sigma=(0.1, 0.2, 0.4))
    settings.attitude_sigma = (0.1, 0.2, 0.4)
    errors = []
    for seed in range(400):
        begin = start(truth, settings, seed)
        ned = pymap3d.geodetic2ned(
            *np.degrees(begin.position[:2]), begin.position[2],
            np.degrees(truth.latitude[0]), np.degrees(truth.longitude[0]), truth.height[0],
        )  # fmt: skip
        errors.append((*ned, *(begin.velocity_n - truth.velocity_n[0])))
    sigma = np.array((1, 2, 4, 0.1, 0.2, 0.4))
    assert np.allclose(np.std(errors, axis=0) / sigma, 1, atol=5 / np.sqrt(2 * 400))
    assert (np.abs(np.mean(errors, axis=0)) < 5 * sigma / np.sqrt(400)).all()


# TOML


def test_toml_there_and_back(short):
    one = experiment(
        short,
        seed=7,
        sensors__gyro__noise_density=(0.1, 0.2, 0.3),
        sensors__gps__outages=[[3, 5], [7, 8.5]],
        navigator__p0=[1.0] * 15,
        navigator__r=np.diag(np.arange(1.0, 7)).tolist(),
        navigator__correction="feedforward",
        trajectory__imu_rate=100,
    )
    again = Experiment.from_toml(one.to_toml())
    assert again.to_dict() == one.to_dict()
    assert bits(again.run()) == bits(one.run())


def test_toml_from_a_file_by_path_or_name(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("\ufeffseed = 5\n[sensors.gps]\nperiod = 0.5\n", encoding="utf-8")
    for source in (path, str(path)):
        one = Experiment.from_toml(source)
        assert (one.seed, one.sensors.gps.period, one.mission) == (5, 0.5, "montreal")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed = ", "is not TOML"),
        ("sede = 1", "Did you mean seed"),
        ("[sensors.gps]\nperiod = 0", "sensors.gps.period = 0: not accepted; accepted is a number from 0.05"),
        ("[sensors.gps]\nperiod = nan", "sensors.gps.period"),
        ("sensors = 3", "sensors: is a group"),
        ("[navigator]\nr = [[1, 2], [3, 4]]", "navigator.r"),
        ('[navigator]\nmodel = "magic"', "one of phi"),
        ("seed = 1.5", "seed"),
    ],
)
def test_a_toml_that_is_not_accepted_says_what_is(tmp_path, text, words):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingError, match=re.escape(words)) as caught:
        Experiment.from_toml(path)
    assert str(path) in str(caught.value)
    with pytest.raises(SettingError, match=re.escape(words)):
        Experiment.from_toml(text)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", None])
def test_a_file_that_is_no_text_or_not_there(tmp_path, content):
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SettingError, match=re.escape(str(path))):
        Experiment.from_toml(path)


def test_an_unknown_mission_lists_those_there_are():
    with pytest.raises(MissionError, match="montreal"):
        Experiment(mission="montral").run()


# Shown


def test_an_experiment_shows_its_settings_with_units_and_what_is_changed(short):
    page = experiment(short, sensors__gps__period=0.5)._repr_html_().replace("<wbr>", "")
    bold = re.findall(r'bold">([^<]*)<', page)
    assert "sensors.gps.period" in bold
    assert "0.5 s" in bold
    assert "sensors.gyro.noise_density" not in bold
    assert "°/s/√Hz" in page


def test_an_experiment_is_one_short_line_on_a_terminal():
    one = Experiment(seed=3)
    one.set("sensors.gps.period", 0.5)
    assert repr(one) == "<Experiment: mission montreal, seed 3, 2 settings not default>"


def test_progress_goes_forward_to_the_end(short):
    told: list[tuple[str, float]] = []
    experiment(short).run(lambda what, done: told.append((what, done)))
    fractions = [done for _, done in told]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1
    assert all(what for what, _ in told)


# Settings at their extremes

GYRO, ACCEL, GPS, NAV = "sensors__gyro__", "sensors__accelerometer__", "sensors__gps__", "navigator__"


@pytest.mark.proof
@pytest.mark.parametrize(
    "settings",
    [
        {f"{sensor}{error}": 0 for sensor in (GYRO, ACCEL) for error in ("noise_density", "bias_sigma")},
        {f"{GPS}position_variance": 1e-6, f"{GPS}velocity_variance": 1e-8},
        {f"{GPS}position_variance": 1e6, f"{GPS}velocity_variance": 1e4},
        {"trajectory__imu_rate": 10, f"{GPS}period": 0.05},
        {"trajectory__imu_rate": 33.3},
        {"trajectory__imu_rate": 2000},
        {f"{NAV}filter_rate": 7},
        {f"{NAV}filter_rate": 1e-300},
        {f"{NAV}position_sigma": 1e-6, f"{NAV}velocity_sigma": 1e-6, f"{NAV}attitude_sigma": 1e-6},
        {f"{NAV}position_sigma": 1e5, f"{NAV}velocity_sigma": 1e3, f"{NAV}attitude_sigma": 180},
        {f"{NAV}p0_scale": 1e6, f"{NAV}q_scale": 1e6, f"{NAV}r_scale": 1e6},
        {f"{NAV}p0_scale": 1e-6, f"{NAV}q_scale": 1e-6, f"{NAV}r_scale": 1e-6},
        {f"{NAV}p0": [0] * 15},
        {f"{NAV}p0": np.ones((15, 15)).tolist()},
        {f"{NAV}q": [0] * 12},
        {f"{NAV}correction": "feedforward", f"{GPS}outages": [[5, 12]]},
        {f"{NAV}correction_period": 600},
        {f"{GYRO}instability": 100, f"{GYRO}bias_sigma": 0, f"{GYRO}correlation_time": 0.1},
    ],
    ids=str,
)
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_settings_at_their_extremes_give_numbers(short, settings):
    usable(run(short, **settings))


@pytest.mark.parametrize("correction", ["feedback", "feedforward"])
@pytest.mark.parametrize("settings", [{f"{GPS}outages": [[0, 1e6]]}, {f"{GPS}period": 60}], ids=str)
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_flight_without_fixes_is_navigated_freely_and_says_so(short, correction, settings):
    result = run(short, **settings, navigator__correction=correction)
    usable(result)
    assert result.gps.sizes["time_gps"] == 0
    assert result.autocorrelation.sizes["lag"] == 0
    assert "No GPS fix" in result.remarks[0]
    assert "No GPS fix" in result._repr_html_()
    assert result.sigma.position.values[-1].min() > 1


def test_a_flight_of_five_seconds(tmp_path):
    path = tmp_path / "five.csv"
    write_flight_csv(path, recording(5))
    result = run(str(path))
    usable(result)
    assert result.gps.sizes["time_gps"] == 5
    assert result.time[-1] == pytest.approx(5)


def test_biases_nobody_doubts_are_left_out_of_nees(short):
    result = run(short, sensors__gyro__bias_sigma=0, sensors__accelerometer__bias_sigma=0)
    assert result.consistency.nees.attrs["degrees"] == 9
    assert not result.sensor_errors.gyro_bias.values.any()
    assert run(short).consistency.nees.attrs["degrees"] == 15


def test_saturation_is_remarked(short):
    assert run(short).remarks == ()
    result = run(short, sensors__gyro__range=1)
    rate = np.abs(result.imu.angular_rate.values)
    assert rate.max() == pytest.approx(1, rel=1e-9)
    met = int(np.count_nonzero(rate > 1 - 1e-9))
    assert f"in {met} values" in result.remarks[0]
    assert "sensors.gyro.range" in repr(result)


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
@pytest.mark.parametrize("r", [[1, 1, 1, 0, 1, 1], np.ones((6, 6)).tolist()], ids=["zero", "rank one"])
def test_a_singular_r_is_refused_by_its_name(short, engine, r):
    with pytest.raises(SettingError, match=r"navigator\.r: is singular"):
        run(short, navigator__r=r, navigator__engine=engine)


def test_a_filter_slower_than_a_bias_is_refused_by_its_name(short):
    with pytest.raises(SettingError, match=r"navigator\.filter_rate.*rate from 10 Hz"):
        run(
            short,
            navigator__filter_rate=1,
            sensors__gyro__correlation_time=0.1,
            sensors__gyro__instability=100,
            sensors__gyro__bias_sigma=0,
        )


@pytest.mark.parametrize(
    "settings",
    [{f"{NAV}p0": [1e300] * 15, f"{NAV}p0_scale": 1e6}, {f"{NAV}q": [1e300] * 12}, {f"{NAV}r": [1e-300] * 6}],
    ids=["p0", "q", "r"],
)
def test_a_filter_that_diverges_says_when_and_is_not_kept(short, settings):
    one = experiment(short, **settings)
    for _ in range(2):
        with pytest.raises(ValueError, match=r"diverged.*from t = \d+\.\d{3} s.*p0"):
            one.run()
    assert "navigation" not in CACHE.computed


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_reference_that_diverges_says_so(short):
    with pytest.raises(ValueError, match="diverged"):
        run(short, navigator__engine="filterpy", navigator__p0=[1e300] * 15, navigator__p0_scale=1e6)


def seed_that_starts_north(sigmas: float) -> int:
    """Return a seed whose initial position error is more than so many σ to the north."""
    return next(seed for seed in range(1000) if unit_draws(seed, "initial error", (9,))[0] > sigmas)


@pytest.mark.parametrize(
    ("flight", "sigma"), [({"latitude": 89.9, "north": -1400}, 2e3), ({"latitude": 88.5}, 1e5)]
)
def test_an_estimate_that_begins_beyond_a_pole_comes_back_with_the_fixes(flight, sigma, tmp_path):
    path = tmp_path / "polar.csv"
    write_flight_csv(path, recording(20, heading=0, **flight))
    begun = run(str(path), navigator__position_sigma=sigma, seed=seed_that_starts_north(1.7))
    error = np.linalg.norm(begun.errors["position"].values, axis=1)
    assert error[0] > sigma
    assert error[-1] < 5


def test_an_estimate_at_a_pole_is_told_from_a_flight_that_goes_there(tmp_path):
    path = tmp_path / "polar.csv"
    write_flight_csv(path, recording(20, latitude=88.5))
    seed = seed_that_starts_north(1.7)
    to_pole = 1.5 * 111.69e3 / float(unit_draws(seed, "initial error", (9,))[0])
    with pytest.raises(ValueError, match="diverged: the estimate moved to a pole"):
        run(str(path), navigator__position_sigma=[to_pole, 1.0, 1.0], seed=seed)


def test_a_mission_can_be_given_by_path(short):
    assert run(short).mission.recording_path == Path(short)


def test_the_time_of_the_navigator_is_that_of_its_computation_cached_or_not() -> None:
    experiment = Experiment(seed=4711)
    first, again = experiment.run(), experiment.run()
    assert again.solution_arrays is first.solution_arrays
    assert again.seconds == first.seconds > 1e-3


def test_a_smoothed_run_has_smaller_errors_and_the_same_innovations() -> None:
    experiment = Experiment(seed=5)
    filtered = experiment.run()
    experiment.set("navigator.smoother", True)
    smoothed = experiment.run()
    before, after = (
        filtered.summary.set_index("quantity")["rms"],
        smoothed.summary.set_index("quantity")["rms"],
    )
    assert (after < 0.8 * before).all()
    assert (smoothed.sigma["position"].mean("time") < filtered.sigma["position"].mean("time")).all()
    # The filter of a smoothed run holds no heading: that moves innovations of 0.7 m by less than 5 cm.
    np.testing.assert_allclose(smoothed.innovations["position"], filtered.innovations["position"], atol=0.05)
    with pytest.raises(SettingError, match=r"navigator\.smoother"):
        _ = smoothed.budget
    experiment.set("navigator.model", "nonlinear")
    with pytest.raises(SettingError, match=r"navigator\.smoother: .*nonlinear"):
        experiment.run()


def test_an_alignment_takes_the_bias_off_as_the_sensor_puts_it_out() -> None:
    """Scale factors and misalignments have changed the bias of some °/s before anyone sees it."""
    experiment = Experiment(mission="los_angeles", seed=3)
    for name, value in {"bias_sigma": 5.0, "scale_factor_sigma": 1.5, "noise_density": 0.003}.items():
        experiment.set(f"sensors.gyro.{name}", value)
    experiment.set("sensors.gyro.misalignment", (0.5, -0.4, 0.3, 0.2, -0.5, 0.6))
    whole = experiment.run()
    experiment.set("navigator.alignment", 30.0)
    result = experiment.run()
    sigma = np.radians(0.003) / np.sqrt(30.0)
    assert np.abs(whole.true_bias[0, :3]).max() > np.radians(1.0)
    assert 0 < np.abs(result.true_bias[:, :3]).max() < 4 * sigma
    # (I + M) x + b + noise, with the bias that is left.
    M = np.radians([[0, 0.5, -0.4], [0.3, 0, 0.2], [-0.5, 0.6, 0]]) + np.diag(result.true_scale[0, :3])
    dt = result.ideal.dt
    put_in = result.ideal.dtheta / dt @ (np.eye(3) + M).T + result.true_bias[0, :3]
    left = result.gyro.increments / dt - put_in
    np.testing.assert_allclose(left.mean(axis=0), 0, atol=4 * np.radians(0.003) / np.sqrt(left.shape[0] * dt))
