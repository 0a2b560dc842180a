"""The plots of the flight have the values of the run itself, computed here in another way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_logs import tables, write

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.navigation.aids import NAMES
from lab.views.figures import TimeAxis
from lab.views.flight_plots import FLIGHT, sensor_plots
from lab.views.quantities import kinds_of_aids, times_of_aid
from lab.views.time_figures import TimeFigures

PLOTS = {plot.name: plot for plot in FLIGHT}


@pytest.fixture(scope="module")
def equipped() -> Result:
    """Return a flight that turns through south, with all sensors that there are."""
    experiment = Experiment(mission="los_angeles")
    experiment.set("trajectory.imu_rate", 50)
    for sensor in ("barometer", "heading", "odometer", "airspeed"):
        experiment.set(f"sensors.{sensor}.fitted", True)
    return experiment.run()


def drawn(result: Result, name: str, label: str) -> np.ndarray:
    plot = next(plot for plot in (*FLIGHT, *sensor_plots(kinds_of_aids(result))) if plot.name == name)
    return next(curve for curve in plot.curves if curve.label == label).read(result)


def test_speed_and_attitude_are_those_of_the_truth(equipped: Result) -> None:
    truth = equipped.truth_arrays
    assert truth is not None
    north, east, down = truth.velocity_n.T
    np.testing.assert_allclose(drawn(equipped, "ground_speed", "truth"), np.sqrt(north**2 + east**2))
    np.testing.assert_allclose(drawn(equipped, "velocity_up", "truth"), -down)
    angles = Rotation.from_quat(truth.q_nb, scalar_first=True).as_euler("ZYX", degrees=True)
    for name, expected in zip(("heading", "pitch", "roll"), angles.T, strict=True):
        values = drawn(equipped, name, "truth")
        known = np.isfinite(values)
        assert np.count_nonzero(~known) <= 5
        off = (values - expected + 180) % 360 - 180
        np.testing.assert_allclose(off[known], 0, atol=1e-6)
        assert np.abs(values[known]).max() <= 180
    fixes = PLOTS["ground_speed"].fixes
    assert fixes is not None
    np.testing.assert_allclose(fixes.read(equipped), np.hypot(*equipped.fixes.velocity_n[:, :2].T))


def test_a_heading_through_south_has_a_gap_and_no_line_across(equipped: Result) -> None:
    heading = drawn(equipped, "heading", "truth")
    steps = np.diff(heading)
    assert np.abs(steps[np.isfinite(steps)]).max() < 5
    assert np.isnan(heading).any()


def test_the_imu_has_its_increments_over_the_interval_before_each_sample(equipped: Result) -> None:
    dt = np.diff(equipped.time)[:, None]
    rates, forces = np.degrees(equipped.gyro.increments / dt), equipped.accelerometer.increments / dt
    for number, axis in enumerate("xyz"):
        rate = drawn(equipped, f"angular_rate_{axis}", "measured")
        np.testing.assert_allclose(rate[1:], rates[:, number])
        force = drawn(equipped, f"specific_force_{axis}", "measured")
        np.testing.assert_allclose(force[1:], forces[:, number])
        true = drawn(equipped, f"specific_force_{axis}", "truth")
        assert np.abs(true - force).mean() < 0.1


def test_other_sensors_stand_beside_what_the_filter_expects(equipped: Result) -> None:
    plots = sensor_plots(kinds_of_aids(equipped))
    assert [plot.name for plot in plots] == [
        f"sensor_{NAMES[kind].replace(' ', '_')}" for kind in kinds_of_aids(equipped)
    ]
    for plot, sensor in (("height", "barometer"), ("speed_forward", "odometer")):
        values = drawn(equipped, f"sensor_{plot}", "measured")
        np.testing.assert_allclose(values, equipped.readings[sensor].value)
    expected = np.interp(equipped.readings["barometer"].time, equipped.time, equipped.truth_arrays.height)
    np.testing.assert_allclose(drawn(equipped, "sensor_height", "truth"), expected, atol=0.1)
    for plot in plots:
        estimate, measured = plot.curves[0].read(equipped), plot.curves[-1].read(equipped)
        assert estimate.shape == times_of_aid(equipped, plot.clock).shape
        off = (measured - estimate + 180) % 360 - 180
        assert np.sqrt(np.nanmean(off**2)) < 3


def test_a_magnetometer_shows_its_heading() -> None:
    experiment = Experiment(mission="los_angeles")
    experiment.set("trajectory.imu_rate", 50)
    experiment.set("sensors.heading.fitted", True)
    experiment.set("sensors.heading.source", "magnetometer")
    result = experiment.run()
    measured, truth = (drawn(result, "sensor_magnetic_heading", word) for word in ("measured", "truth"))
    off = (measured - truth + 180) % 360 - 180
    assert np.sqrt(np.nanmean(off**2)) < 3


def test_a_long_flight_is_read_in_parts(equipped: Result) -> None:
    part = equipped.part(1999, 3000)
    for plot in FLIGHT:
        for curve in plot.curves:
            whole = curve.read(equipped)[2000:3000]
            np.testing.assert_allclose(curve.read(part)[1:], whole, atol=1e-9, err_msg=curve.name)


@pytest.mark.parametrize("has_reference", [False, True])
def test_a_log_has_no_truth_but_its_reference(tmp_path: Path, has_reference: bool) -> None:
    folder = write(tmp_path / "drive", tables(60, 90), 'title = "Drive"')
    if not has_reference:
        (folder / "ref.csv").unlink()
    result = Experiment(mission=str(folder)).run()
    axis = TimeAxis()
    axis.span(float(result.time[-1]))
    figures = TimeFigures(FLIGHT, axis)
    figures.show(result)
    assert all(fig.visible for fig in figures.figures)
    entries = figures._legends
    assert entries["height_true"].visible == has_reference
    assert not entries["angular_rate_x_true"].visible
    assert np.isfinite(drawn(result, "specific_force_z", "measured")).all()
    assert np.isfinite(drawn(result, "ground_speed", "truth")).any() == has_reference
