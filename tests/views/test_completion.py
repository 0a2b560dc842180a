"""Completion: a running IPython lists settings with unit and bounds, and plots; nothing of the machinery."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from IPython.core.completer import provisionalcompleter
from IPython.core.interactiveshell import InteractiveShell

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.sensors.imu_errors import GyroErrors
from lab.views.cards import PLOTS
from lab.views.completion import register_completion

Complete = Callable[[str], dict[str, str]]


@pytest.fixture(scope="module")
def result() -> Result:
    """Return a result, not yet asked for anything."""
    experiment = Experiment(mission="los_angeles")
    experiment.trajectory.imu_rate = 50
    return experiment.run()


@pytest.fixture(scope="module")
def complete(result: Result) -> Iterator[Complete]:
    """Return a function that presses Tab at the end of a text, and returns the names and their kinds."""
    shell = InteractiveShell.instance()
    shell.user_ns["experiment"] = Experiment(mission="los_angeles")
    shell.user_ns["other"] = object()
    shell.user_ns["result"] = result
    register_completion()

    def press(text: str) -> dict[str, str]:
        with provisionalcompleter():
            found = list(shell.Completer.completions(text, len(text)))
        # JupyterLab breaks a line at each common space, and at a stroke before a root.
        assert not any("°" in one.type and (" " in one.type or "/√" in one.type) for one in found)
        kinds = {one.text: one.type.replace("\N{NO-BREAK SPACE}", " ") for one in found}
        return {name: kind.replace("\N{WORD JOINER}", "") for name, kind in kinds.items()}

    yield press
    InteractiveShell.clear_instance()


def test_a_group_completes_to_its_settings_with_unit_and_bounds(complete: Complete) -> None:
    found = complete("experiment.sensors.gyro.")
    own = len(GyroErrors().to_dict())
    assert set(list(found)[:own]) == set(GyroErrors().to_dict())  # the settings first, then the methods
    assert set(list(found)[own:]) == {"copy", "get", "set", "to_dict", "update"}
    assert found["noise_density"] == "0.05 °/s/√Hz, from 0 to 10"
    assert found["copy"] == "an independent copy"


def test_every_setting_says_what_it_is(complete: Complete) -> None:
    found = complete("experiment.sensors.") | complete("experiment.navigator.")
    assert "<unknown>" not in found.values()
    assert found["assumed"] == "not set; text"
    assert found["initial_heading"] == "not set; from -360 to 360 °"


def test_a_result_completes_its_plots_with_what_they_show(complete: Complete) -> None:
    found = complete("result.plot.")
    assert set(found) == set(PLOTS)
    assert found["consistency"].startswith("NEES and NIS with their 95 % intervals")
    assert set(complete("print(result.plot.ground")) == {"ground_track"}


def test_a_result_completes_what_it_has_and_computes_nothing(complete: Complete, result: Result) -> None:
    found = complete("result.")
    assert found["errors"].startswith("Errors of the solution: estimate minus")
    assert {"plot", "verdict", "summary", "view3d", "explore", "to_netcdf"} <= set(found)
    assert "CARD" not in found
    assert not {"errors", "verdict", "consistency"} & set(vars(result))


def test_a_beginning_is_completed_also_inside_a_call(complete: Complete) -> None:
    assert set(complete("print(experiment.sensors.gyro.noi")) == {"noise_density"}
    assert "phi, one of" in complete("x = experiment.navigator.mod")["model"]


@pytest.mark.parametrize("call", ['experiment.set("', "experiment.get('", 'experiment.sweep({\n  "'])
def test_dotted_paths_are_completed_inside_quotes(complete: Complete, call: str) -> None:
    found = complete(f"{call}sensors.gps.peri")
    assert found == {"sensors.gps.period": "1 s, from 0.05 to 60"}


@pytest.mark.parametrize("text", ["experiment.no.such.", "other.", "nobody.sensors.", "experiment._"])
def test_other_words_are_left_to_ipython(complete: Complete, text: str) -> None:
    assert "function" not in {kind for name, kind in complete(text).items() if "gyro" in name}
    assert not any("noise_density" in name for name in complete(text))


def test_dir_and_the_question_mark_show_settings_and_no_machinery() -> None:
    experiment = Experiment()
    assert {"mission", "seed", "sensors", "run", "sweep", "to_toml", "copy"} <= set(dir(experiment))
    assert not {"param", "name"} & set(dir(experiment))
    text = experiment.sensors.gyro.getdoc()
    assert "\x1b" not in text
    assert "noise_density = 0.05 °/s/√Hz\n    accepted: one number, or 3 (x, y, z), each from 0 to 10" in text
    assert "gyro, accelerometer" in experiment.getdoc()
