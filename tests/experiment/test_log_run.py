"""Experiments on sensor logs: nothing simulated, errors against the reference or not at all."""

from __future__ import annotations

import numpy as np
import pytest
from copter_logs import copter
from sensor_logs import changed, tables, trajectory, write, write_csv

from lab import Experiment, ResultError, compare, run_ensemble
from lab.base.parameters.setting_error import SettingError
from lab.data.log.auxiliary_data import Reference
from lab.experiment.log_result import LogResult
from lab.experiment.log_run import has_effect
from lab.experiment.result import DATASETS
from lab.experiment.stages import CACHE
from lab.missions import MissionError, mission, read_sensor_log
from lab.motion.frames.rotation import wrap
from lab.navigation.algorithm import Estimate
from lab.navigation.log_navigation import navigate_log
from lab.run.log_reference import differences, interpolate_reference


def experiment(folder, **settings):
    made = Experiment(mission=str(folder))
    made.update({"sensors": {"gyro": {"bias_sigma": 0.3}, "gps": {"velocity_variance": 0.01}}})
    for path, value in settings.items():
        made.set(path.replace("__", "."), value)
    return made


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write(tmp_path_factory.mktemp("logs") / "drive", tables(60, 120), 'title = "Drive"')


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    """Return a log without reference and without vertical velocity."""
    folder = write(tmp_path_factory.mktemp("logs") / "blind", tables(60, 120))
    (folder / "ref.csv").unlink()
    rows = (folder / "gnss.csv").read_text().splitlines()
    kept = [",".join(cell for i, cell in enumerate(row.split(",")) if i not in {6, 9}) for row in rows]
    (folder / "gnss.csv").write_text("\n".join(kept))
    return folder


def test_a_long_time_without_fixes_is_reported_with_its_sigma(folder, tmp_path):
    log = tables(60, 120)
    few = write(
        tmp_path / "few", log._replace(gnss=log.gnss[(log.gnss[:, 0] < 1070) | (log.gnss[:, 0] > 1100)])
    )
    result = experiment(few).run()
    said = next(remark for remark in result.remarks if "coasts" in remark)
    assert "no fix for up to 31 s, from 1069.5 s to 1100.5 s in the clock of the file" in said
    sigma = result.sigma.position.sel(time=slice(9.5, 40.5))
    level = float(sigma.sel(axis=["north", "east"]).max())
    assert f"{level:.2g} m" in said
    assert not any("coasts" in remark for remark in experiment(folder).run().remarks)


def test_errors_against_the_reference(folder, tmp_path):
    result = experiment(folder).run()
    late = result.errors.sel(time=slice(30, None))
    assert float(np.abs(late.position.mean("time")).max()) < 0.3
    assert float(np.abs(late.attitude.sel(angle=["roll", "pitch"])).max()) < 1.0
    assert set(result.datasets()) == set(DATASETS) - {"consistency"}
    assert {"mean", "std"} <= set(result.summary.columns)
    assert np.isfinite(result.summary[["rms", "max", "mean", "std"]].to_numpy()).all()
    assert "reference, which has errors of its own" in " ".join(result.remarks)
    assert "The vehicle is unknown: the course is used as its heading" in " ".join(result.remarks)
    assert result.verdict.basis == "1 run, innovations only"
    assert "_true" not in " ".join(map(str, (*result.imu, *result.sensor_errors)))
    result.to_netcdf(tmp_path / "result.nc")
    result.to_csv(tmp_path / "csv")
    assert "estimate minus reference" in result._repr_html_()
    assert "mean" in repr(result)


def test_the_result_of_a_log_is_of_a_class_of_its_own(folder):
    result = experiment(folder).run()
    assert isinstance(result, LogResult)
    assert result.ideal is result.aligned is None
    assert (result.truth_word, result.realisation) == ("reference", "")
    assert result.epoch == result.recorded.log.epoch
    assert not result.has_temperature


def test_without_reference_errors_are_not_known(blind, tmp_path):
    result = experiment(blind).run()
    assert set(result.datasets()) == set(DATASETS) - {"consistency", "truth", "errors"}
    for name in ("truth", "errors", "summary", "consistency", "coverage", "budget"):
        with pytest.raises(ResultError, match=r"Innovations or the Verdict|the innovations and the verdict"):
            getattr(result, name)
    assert list(result.track.path.values) == ["estimated"]
    assert list(result.whiteness["innovation"]) == [
        *(f"position {axis}" for axis in ("east", "north", "up")), "velocity east", "velocity north",
    ]  # fmt: skip
    whole = run_ensemble(experiment(blind), 1).whiteness.set_index("innovation")
    one = result.whiteness.set_index("innovation")
    assert list(whole.index) == list(one.index)
    np.testing.assert_allclose(whole[["mean", "variance"]], one[["mean", "variance"]], rtol=1e-9)
    assert result.innovations.nis.attrs["degrees"] == 5
    assert np.isnan(result.innovations.velocity_sigma.sel(axis="up")).all()
    result.to_netcdf(tmp_path / "result.nc")
    result.to_csv(tmp_path / "csv")
    assert (tmp_path / "csv" / "whiteness.csv").is_file()
    assert "has no reference" in result._repr_html_()
    assert "no vertical velocity" in repr(result)


def test_what_is_not_measured_does_not_count_as_consistent(blind):
    """Five numbers in a fix: NIS of the matched filter is theirs, not that of six."""
    made = experiment(blind, sensors__gps__velocity_variance=0.01, sensors__gps__position_variance=0.25).run()
    nis = made.evidence.innovations.nis
    assert nis.number == 5 * np.count_nonzero(made.solution_arrays.fix_sample >= 0)
    assert 0.7 < nis.mean < 1.3


def test_navigation_is_cached_by_what_it_depends_on(folder):
    first = experiment(folder).run()
    count = CACHE.computed["log navigation"]
    for path, value in (
        ("seed", 7),
        ("sensors.gyro.scale_factor", (1.0,) * 3),
        ("trajectory.imu_rate", 50.0),
    ):
        made = experiment(folder)
        made.set(path, value)
        result = made.run()
        assert result.solution_arrays is first.solution_arrays
        assert any(path in remark and "has no effect" in remark for remark in result.remarks)
    assert CACHE.computed["log navigation"] == count
    assert experiment(folder, navigator__r_scale=2.0).run().solution_arrays is not first.solution_arrays


SWITCHED = frozenset(f"navigator.{name}_sigma" for name in ("zero_velocity", "slip", "lever_arm", "latency"))
"""Settings of states and measurements that are off by default."""


@pytest.mark.proof
def test_settings_have_an_effect_where_they_say_so(folder):
    """Every number of the sensors and of the start, one by one, against the navigation itself."""
    base = experiment(folder)
    for triad in ("gyro", "accelerometer"):
        for term in ("instability", "flicker", "rate_random_walk", "bias"):
            base.set(f"sensors.{triad}.{term}", 0.5)
    # With 0.5 °/h the noise hides the changes of the bias: the correlation time would not matter.
    base.set("sensors.gyro.instability", 30.0)
    base.set("sensors.accelerometer.vibration_density", 20.0)
    base.set("sensors.temperature.profile", "constant")
    log = read_sensor_log(folder)
    # The receiver's own σ would stand in for the variances of the settings.
    log.gnss.position_sigma[:], log.gnss.velocity_sigma[:] = np.nan, np.nan

    def end(made):
        run = navigate_log(log, made.sensors, made.navigator, made.sensors.gps.outages)
        return np.concatenate((run.solution.velocity_n[-1], run.solution.variance[-1]))

    plain = end(base)
    for path, owner, name in base.leaves():
        value, declared = getattr(owner, name), owner.param[name]
        numbers = value if isinstance(value, tuple) else (value,)
        wanted = path.startswith("sensors.") or path.endswith(("_sigma", "_error"))
        is_number = bool(numbers) and all(type(number) is float for number in numbers)
        if path in SWITCHED or not wanted or not is_number:
            continue
        other = base.copy()
        other.set(path, changed(value, declared.bounds))
        assert (end(other) != plain).any() == has_effect(path, base.navigator, ()), path
    other = base.copy()
    other.set("sensors.gps.outages", [(40.0, 50.0)])
    assert (end(other) != plain).any()


def test_an_outage_withholds_fixes(folder):
    cut = experiment(folder, sensors__gps__outages=[(1080.0, 1100.0)]).run()
    assert not ((cut.fixes.time >= 20) & (cut.fixes.time <= 40)).any()
    at = np.searchsorted(cut.time, 39.9)
    assert cut.solution_arrays.variance[at, 0] > 10 * experiment(folder).run().solution_arrays.variance[at, 0]


def test_gate_and_smoother_and_feedforward(folder):
    plain = experiment(folder).run()
    assert experiment(folder, navigator__gate=0.5).run().solution_arrays.fix_rejected.any()
    # Feedforward lets the navigator run free, so that both agree only while its errors are small.
    forward = experiment(folder, navigator__correction="feedforward").run()
    apart = np.abs(forward.errors.position - plain.errors.position).sel(time=slice(None, 5))
    assert 0 < float(apart.max()) < 0.1
    smoothed = experiment(folder, navigator__smoother=True).run()
    early = slice(1, 20)
    for name, index in (("position", slice(0, 3)), ("velocity", slice(3, 6))):
        assert float((smoothed.errors[name].sel(time=early) ** 2).mean()) < float(
            (plain.errors[name].sel(time=early) ** 2).mean()
        )
        assert (
            smoothed.solution_arrays.variance[:, index] <= plain.solution_arrays.variance[:, index] * 1.001
        ).all()


def test_a_log_is_smoothed_over_short_gaps(tmp_path):
    flown = tables(60, 80)
    rows = (flown.imu[:, 0] > 1070.2) & (flown.imu[:, 0] < 1070.9)
    gappy = write(tmp_path / "gap", flown._replace(imu=flown.imu[~rows]))
    made = experiment(gappy, navigator__smoother=True).run()
    assert any("1 gap of the IMU" in remark for remark in made.remarks)
    filtered = experiment(gappy).run()
    at = np.searchsorted(made.time, 10.5)
    smoothed = made.solution_arrays.variance
    assert (smoothed[:, :9] > 0).all()
    assert (smoothed[at, :6] < filtered.solution_arrays.variance[at, :6]).all()


def test_what_cannot_be_done_is_refused(folder):
    with pytest.raises(SettingError, match="reference in filterpy cannot handle gaps of the IMU or"):
        experiment(folder, navigator__engine="filterpy").run()
    with pytest.raises(ValueError, match="3 runs of a sensor log would all be the same"):
        run_ensemble(experiment(folder), 3)


def test_models_are_compared_on_one_run(blind):
    (row,) = compare(experiment(blind), ["phi"])
    assert np.isnan([row.position, row.velocity, row.heading, row.nees]).all()
    assert row.degrees == 0
    assert row.nis_degrees == 5
    assert np.isfinite([row.nis, row.seconds]).all()
    assert row.verdict


def test_own_algorithm_is_given_the_log(folder):
    class Standing:
        def navigate(self, imu, fixes, start):
            n = imu.time.size
            return Estimate(
                np.tile(start.position, (n, 1)),
                np.zeros((n, 3)),
                np.tile(start.q_nb, (n, 1)),
                np.ones((n, 9)),
            )

    result = experiment(folder).run(algorithm=Standing())
    assert float(result.errors.position.std()) > 10


def test_observability_needs_only_the_filter(blind):
    made = experiment(blind).run().observability
    sigma, free = made.sigma.sel(quantity="velocity north"), made.free.sel(quantity="velocity north")
    assert float(sigma[-1]) < 0.2 * float(free[-1])
    assert np.isfinite(made.free.values).all()
    assert made.free.values[-1, 0] > made.free.values[0, 0]


def test_reference_between_its_rows():
    """On the flight of the log: cubic with velocities, NaN outside, in gaps, and where not known."""
    rows, times = np.arange(60.0, 80.0, 1.0), np.arange(58.0, 82.0, 0.05)
    there, truth = trajectory().at(rows), trajectory().at(times)
    position = np.stack((there.latitude, there.longitude, there.height), axis=-1)
    given = Reference(rows, position, there.velocity_n, there.euler)
    made = interpolate_reference(given, times)
    inside = (times >= 60) & (times <= 79)
    np.testing.assert_array_equal(np.isfinite(made.latitude), inside)
    np.testing.assert_allclose(made.height[inside], truth.height[inside], atol=0.05)
    np.testing.assert_allclose(made.latitude[inside] * 6.37e6, truth.latitude[inside] * 6.37e6, atol=0.05)
    np.testing.assert_allclose(wrap(made.euler[inside] - truth.euler[inside]), 0, atol=np.radians(1.5))
    late = rows > 65.5
    kept = (rows < 63.5) | late
    gappy = interpolate_reference(
        Reference(*(part[kept] for part in (rows, position, there.velocity_n, there.euler))), times
    )
    hole = (times > 63.001) & (times < 65.999)
    assert np.isnan(gappy.latitude[hole]).all()
    assert np.isfinite(gappy.latitude[inside & ~hole & (np.abs(times - 64.5) > 1.6)]).all()
    unknown = interpolate_reference(
        given.__class__(rows, position, np.full((20, 3), np.nan), np.full((20, 3), np.nan)), times
    )
    assert np.isnan(unknown.velocity_n).all()
    assert np.isnan(unknown.q_nb).all()
    assert np.isfinite(unknown.latitude[inside]).all()
    assert interpolate_reference(given, times + 1000) is None


def test_a_log_is_found_by_its_path_in_settings(folder):
    text = experiment(folder).to_toml()
    assert Experiment.from_toml(text).mission == str(folder)
    assert mission(folder).name == str(folder)


def test_a_stretch_and_outages_are_of_the_clock_of_the_file(folder):
    """The log begins at 1060 s of its file."""
    part = experiment(folder, navigator__log_from=1070.0, navigator__log_to=1100.0).run()
    assert part.time[0] == pytest.approx(0, abs=0.02)
    assert part.time[-1] == pytest.approx(30, abs=0.02)
    assert any("1070 to 1100 s of the file's clock, as requested" in remark for remark in part.remarks)
    assert any("Time 0 is 1070 s in the clock of the file" in remark for remark in part.remarks)
    cut = experiment(
        folder, navigator__log_from=1070.0, navigator__log_to=1100.0, sensors__gps__outages=[(1080.0, 1090.0)]
    ).run()
    withheld = set(np.round(part.fixes.time + 1070, 3)) - set(np.round(cut.fixes.time + 1070, 3))
    assert withheld == {time for time in np.round(part.fixes.time + 1070, 3) if 1080 <= time <= 1090}
    aside = experiment(folder, sensors__gps__outages=[(20.0, 40.0)]).run()
    assert any("outages outside the log have no effect: 20 to 40 s" in remark for remark in aside.remarks)


def test_a_reference_of_attitude_alone_gives_its_errors(tmp_path):
    flown = tables(60, 100)
    write(tmp_path, flown)
    names = ("t_s", "roll_deg", "pitch_deg", "heading_deg")
    write_csv(tmp_path / "ref.csv", names, flown.reference[:, [0, 7, 8, 9]])
    result = experiment(tmp_path).run()
    assert list(result.summary["quantity"]) == ["attitude roll", "attitude pitch", "attitude heading"]
    assert (result.summary["max"] < 12).all()
    assert np.isnan(result.errors.position).all()
    assert {"estimated"} <= set(result.track.path.values)
    result.to_netcdf(tmp_path / "result.nc")
    assert "estimate minus reference" in result._repr_html_()


def test_another_solution_is_compared_with_and_no_truth(tmp_path):
    flown = tables(60, 100)
    write(tmp_path, flown, '[comparisons]\n"their filter" = "theirs.csv"')
    (tmp_path / "ref.csv").rename(tmp_path / "theirs.csv")
    result = experiment(tmp_path).run()
    assert result.truth_arrays is None
    (remark,) = (remark for remark in result.remarks if "their filter" in remark)
    assert "not the truth" in remark
    made = differences(
        read_sensor_log(tmp_path).auxiliary.comparisons[0], result.time, result.solution_arrays
    )
    # It is the truth here, so that the differences are the errors.
    write(tmp_path / "told", flown)
    errors = experiment(tmp_path / "told").run().errors
    known = np.isfinite(made["position"][:, 0])
    np.testing.assert_allclose(made["position"][known][:, 1], errors.position[known, 0], atol=1e-4)
    np.testing.assert_allclose(np.degrees(made["attitude"][known]), errors.attitude[known], atol=1e-6)


def test_a_vehicle_that_only_the_settings_name(tmp_path):
    """Read as any vehicle's, the log of a copter that looks aside is refused."""
    folder = write(tmp_path, copter(60, nose=1.6, aside=True))
    with pytest.raises(MissionError, match="vehicle"):
        experiment(folder).run()
    result = experiment(folder, navigator__vehicle="copter").run()
    assert not any("The vehicle is unknown" in remark for remark in result.remarks)
    assert abs(float(result.errors.attitude.sel(angle="heading")[0])) < 5


def test_a_log_in_pieces_is_navigated_in_its_longest(tmp_path):
    flown = tables(60, 140)
    rows = (flown.imu[:, 0] < 1080) | (flown.imu[:, 0] > 1100)
    result = experiment(write(tmp_path, flown._replace(imu=flown.imu[rows]))).run()
    assert result.time[-1] == pytest.approx(40, abs=0.02)
    assert any("1 gap of more than 2 s, up to 20" in remark for remark in result.remarks)
    early = slice(10, None)
    assert float(np.abs(result.errors.position.sel(time=early).mean("time")).max()) < 0.5
    other = experiment(tmp_path, navigator__log_to=1085.0).run()
    assert other.time[-1] == pytest.approx(20, abs=0.03)
