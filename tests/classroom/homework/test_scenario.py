"""Scenario and hidden experiment: what is hidden acts, and is in nothing that a student sees or saves."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from bokeh.models import ColumnDataSource

from dashboards.exchange import gpx_file, kml_file, zipped_csv
from dashboards.query import query
from lab.base.notebook_card import NotebookCard
from lab.base.parameters.setting_error import SettingError
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.homework.hidden_experiment import HiddenExperiment
from lab.classroom.homework.homework import Homework
from lab.classroom.homework.scenario import Hidden, Scenario
from lab.experiment.experiment import Experiment
from lab.views.figures import TimeAxis
from lab.views.quantities import SENSOR_ERRORS
from lab.views.report import _plots as report_plots
from lab.views.report import report_html
from lab.views.time_figures import TimeFigures

SHOWN = {"mission": "los_angeles", "trajectory": {"imu_rate": 20}}
BIAS, ARM, SEED = 0.0437219, 2.6173911, 3141592653
MISALIGNED = [0.31, -0.22, 0.13, 0.41, -0.32, 0.23]
SECRET = {"sensors": {"gyro": {"bias": [BIAS, 0.0, 0.0]}, "gps": {"lever_arm": [ARM, 0.0, 0.0]}}}


def scenario(*change: str, hidden: Hidden | None = None) -> Scenario:
    return Scenario("abc", "A title", SHOWN, change or ("navigator",), hidden or Hidden((), SECRET, SEED))


def experiment(*change: str, hidden: Hidden | None = None) -> HiddenExperiment:
    return Homework(scenario(*change, hidden=hidden), "", b"").experiment()


def test_a_hidden_fault_acts_as_in_the_gallery() -> None:
    for name in ("latency", "gravity", "jitter", "r"):
        hidden = experiment(hidden=Hidden((name,), {}, 1)).run()
        gallery = FaultyExperiment(FAULTS[name]).update(SHOWN).run()
        assert np.array_equal(hidden.solution_arrays.position, gallery.solution_arrays.position), name


def test_hidden_settings_act_as_the_same_settings_which_the_filter_does_not_know() -> None:
    arm = {"sensors": {"gps": SECRET["sensors"]["gps"]}}
    for secret in (arm, SECRET):
        hidden = experiment(hidden=Hidden((), secret, SEED)).run()
        # The same sensors without any homework; the filter is told that the antenna is at the IMU.
        plain = Experiment().update(SHOWN).update(secret).update({"seed": SEED})
        plain.set("navigator.lever_arm", [0.0, 0.0, 0.0])
        same = plain.run()
        assert np.array_equal(hidden.gyro.increments, same.gyro.increments)
        assert np.array_equal(hidden.fixes.position, same.fixes.position)
        if secret is arm:
            assert np.array_equal(hidden.solution_arrays.position, same.solution_arrays.position)
    # P0 of a gyro's bias contains the square of a bias that is known to be there.
    apart = same.belief.P0 - hidden.belief.P0
    assert apart[9, 9] == pytest.approx(np.radians(BIAS) ** 2)
    assert np.count_nonzero(apart) == 1


def test_what_a_student_changes_does_not_change_the_sensors_or_the_start() -> None:
    first = experiment().run()
    better = experiment("navigator", "sensors")
    better.update(
        {
            "sensors": {
                "gyro": {"noise_density": 0.0},
                "gps": {"position_variance": 1e-4},
            },
            "navigator": {"attitude_sigma": 1e-3, "position_sigma": 1e-3},
        }
    )
    second = better.run()
    assert np.array_equal(first.gyro.increments, second.gyro.increments)
    assert np.array_equal(first.fixes.position, second.fixes.position)
    start = [result.errors.isel(time=0) for result in (first, second)]
    assert np.allclose(start[0].attitude, start[1].attitude)
    assert np.abs(start[0].attitude).max() > 0.1


def test_the_true_values_of_further_states_are_the_hidden_ones() -> None:
    """Misalignments, with all the states of a sensor card: that filter is compiled for other tests too."""
    secret = {"sensors": {"gyro": {"misalignment": MISALIGNED}}}
    changed = experiment(hidden=Hidden((), secret, SEED))
    estimated = ("navigator.estimate_misalignments", "navigator.estimate_g_sensitivity")
    changed.update({"navigator.states": 21, **dict.fromkeys(estimated, True)})
    result = changed.run()
    assert result.true_further()[0, :6] == pytest.approx(np.radians(MISALIGNED))
    assert "truth" not in result.further_states


def test_another_seed_is_another_realisation_of_the_hidden_run() -> None:
    changed = experiment()
    changed.set("seed", 2)
    plain = Experiment().update(SHOWN).update(SECRET).update({"seed": SEED + 1})
    assert np.array_equal(changed.run().gyro.increments, plain.run().gyro.increments)


def test_a_run_takes_flight_and_rate_from_the_homework() -> None:
    for path, value in (
        ("mission", "montreal"),
        ("trajectory.imu_rate", 1000.0),
        ("sensors.gps.period", 0.1),
        ("sensors.barometer.fitted", True),
    ):
        other = experiment("navigator", "sensors")
        other.set(path, value)
        with pytest.raises(SettingError, match=path):
            other.run()
        with pytest.raises(SettingError, match=path):
            other.scenario.changes(other)


def test_only_allowed_changes_count() -> None:
    changed = experiment("navigator.r_scale", "sensors.gps")
    changed.set("seed", 5)
    changed.set("navigator.r_scale", 2.0)
    assert changed.scenario.changes(changed) == {"navigator.r_scale": 2.0}
    changed.set("sensors.gps.outages", [(10.0, 20.0)])
    with pytest.raises(SettingError, match="outages"):
        changed.scenario.changes(changed)


@pytest.mark.parametrize("kind", ["settings", "fault"])
def test_nothing_that_a_student_sees_or_saves_has_what_is_hidden(tmp_path: Path, kind: str) -> None:
    hidden = Hidden((), SECRET, SEED) if kind == "settings" else Hidden(("latency",), {}, SEED)
    result = experiment(hidden=hidden).run()
    words = [f"{BIAS:.5g}", f"{ARM:.5g}", str(SEED), "latency = 0.12", FAULTS["latency"].title]
    texts = list(_texts(result.experiment)) + list(_texts(result))
    texts += [result.experiment.to_toml(), query(result.experiment), json.dumps(result.experiment.to_dict())]
    texts += [kml_file(result, print).decode(), gpx_file(result, print).decode(), *result.remarks]
    texts += [repr(hidden), repr(result.experiment.scenario), result.experiment.hidden]  # type: ignore[attr-defined]
    with zipfile.ZipFile(io.BytesIO(zipped_csv(result, print))) as archive:
        texts += [archive.read(name).decode() for name in archive.namelist() if name.endswith(".toml")]
        headers = [archive.read(name).decode().partition("\n")[0] for name in archive.namelist()]
    result.to_netcdf(tmp_path / "run.nc")
    with netCDF4.Dataset(tmp_path / "run.nc") as file:
        texts += [str(file.getncattr(name)) for name in file.ncattrs()]
        for group in file.groups.values():
            headers += list(group.variables)
            for variable in group.variables.values():
                values = np.asarray(variable[:])
                if values.dtype.kind == "f":
                    assert not np.isclose(values, BIAS, rtol=1e-6).any(), variable.name
                    assert not np.isclose(values, ARM, rtol=1e-6).any(), variable.name
    texts.append(report_html(result))
    for _title, figures in report_plots(result, ()):
        for source in {source for fig in figures for source in fig.select({"type": ColumnDataSource})}:
            for name, values in source.data.items():
                if np.asarray(values).dtype.kind not in "fiub":  # as the marks of start and end
                    texts += map(str, values)
                    continue
                for secret in (BIAS, ARM):
                    assert not np.isclose(np.asarray(values, dtype=float), secret, rtol=1e-6).any(), name
    for text in texts:
        assert not [word for word in words if word in text]
    shown = " ".join(headers)
    assert "gyro_bias" in shown
    assert not [word for word in ("bias_true", "position_error [m]", "rate_true") if word in shown]


def _texts(thing: NotebookCard) -> list[str]:
    """Return the text and the card of an object."""
    card = thing._repr_html_() if hasattr(thing, "_repr_html_") else ""
    return [repr(thing), str(thing), card or ""]


def test_the_budget_is_withheld_and_says_why() -> None:
    result = experiment().run()
    assert "hidden" in result.missing_reason("budget")
    with pytest.raises(ValueError, match="hidden"):
        _ = result.budget


def test_a_legend_names_no_truth_that_is_hidden() -> None:
    plain = Experiment().update(SHOWN).run()
    axis = TimeAxis()
    figures = TimeFigures(SENSOR_ERRORS, axis)
    for result, is_shown in ((plain, True), (experiment().run(), False), (plain, True)):
        axis.span(float(result.time[-1]))
        figures.show(result)
        for fig in figures.figures:
            (legend,) = fig.legend
            shown = {item.label.value: item.visible for item in legend.items}
            assert shown == {"estimate": True, "truth": is_shown}, fig.title.text
            assert fig.visible
