"""The JSON of a result: the fields that the document describes, no NaN, and the values of the Python API."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from document_code import ROOT
from sensor_logs import tables, write

from lab.analysis.consistency import chi_square_interval
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result

FREE = {
    *("versions", "settings", "changed", "missing", "identification.changes", "points[].values"),
    *("given.swept", "given.fixed"),
}
"""Objects whose keys are names of other things."""
VALUES = re.compile(r"(verdict\.\w+\[\]\.changes\[\]\.value|verdict\.suggestions\[\]\.changes\[\]).*")
MAY_LACK = {"identification.at_bounds[]", "gaps.filled[][]", "gaps.breaks[][]", "out", "export", "report"}
"""Lists that are empty in these runs, and the fields of commands."""


def paths(value: Any, path: str = "") -> Iterator[str]:
    """Iterate over the paths of all values, as the document writes them."""
    if isinstance(value, dict) and path not in FREE:
        for name, one in value.items():
            yield from paths(one, f"{path}.{name}" if path else name)
    elif isinstance(value, list):
        for one in value:
            yield from paths(one, f"{path}[]")
    else:
        yield VALUES.sub(r"\1", path)


def fields_of(title: str) -> list[str]:
    """Return the fields that the document describes for a run, an ensemble or a sweep."""
    parts = re.split(
        r"^##? (Runs as JSON|An ensemble|A sweep)$", (ROOT / "docs/json.md").read_text("utf-8"), flags=re.M
    )
    found = re.findall(r"^\| `([\w.\[\]]+)` \|", parts[parts.index(title) + 1], re.M)
    assert len(found) == len(set(found))
    return found


def are_described(title: str, data: dict[str, Any], may_lack: set[str]) -> None:
    """Check that the document describes all fields of data, and no field that is not there."""
    described, written = fields_of(title), set(paths(data))
    assert {path for path in written if path not in described and not path.startswith("verdict.")} == set()
    missing = [
        one for one in described if not any(re.match(rf"{re.escape(one)}(\W|$)", path) for path in written)
    ]
    assert set(missing) == may_lack


def simulated(**navigator: float) -> Experiment:
    made = Experiment(mission="los_angeles", seed=4)
    return made.update({"trajectory": {"imu_rate": 50.0}, "navigator": navigator})


@pytest.fixture(scope="module")
def result() -> Result:
    return simulated(q_scale=0.1).run()


@pytest.fixture(scope="module")
def data(result: Result) -> dict[str, Any]:
    return result.to_dict(budget=True, identification=result.identify())


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = write(tmp_path_factory.mktemp("logs") / "drive", tables(20, 80))
    return Experiment(mission=str(folder)).run()


def strict(text: str) -> Any:
    """Parse what every parser of JSON reads: neither NaN nor infinity."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


def test_the_document_describes_exactly_the_fields_that_are_written(
    data: dict[str, Any], log: Result
) -> None:
    described = fields_of("Runs as JSON")
    runs = (log, simulated().run(), simulated(r_scale=1e-6).run())
    written = {*paths(data), *(path for run in runs for path in paths(run.to_dict()))}
    assert written - set(described) == set()
    unwritten = {
        path for path in described if not any(re.match(rf"{re.escape(path)}(\W|$)", one) for one in written)
    }
    assert {path for path in unwritten if not path.startswith("verdict.suggestions")} <= MAY_LACK


def test_values_are_those_of_python(result: Result, data: dict[str, Any]) -> None:
    assert [row["rms"] for row in data["summary"]] == list(result.summary["rms"])
    assert [row["p95"] for row in data["summary"]] == list(result.summary["95 %"])
    assert [row["inside_3_sigma"] for row in data["coverage"]] == list(result.coverage["within ±3σ [%]"])
    for name, group in (("nees", result.consistency), ("nis", result.innovations)):
        values = group[name].values[np.isfinite(group[name].values)]
        low, high = chi_square_interval(group[name].attrs["degrees"])
        assert data[name]["mean"] == values.mean()
        assert data[name]["inside_95"] == pytest.approx(
            100 * sum(low <= one <= high for one in values) / len(values)
        )
    (first, *_), found = data["verdict"]["findings"], result.tried_verdict
    assert data["verdict"]["headline"] == found.headline
    assert (first["quantity"], first["factor"]) == ("Q", found.findings[0].factor)
    assert first["changes"][0]["path"] == found.findings[0].changes[0].path == "navigator.q_scale"
    assert data["changed"] == {
        "mission": "los_angeles",
        "seed": 4,
        "trajectory.imu_rate": 50.0,
        "navigator.q_scale": 0.1,
    }
    assert data["budget"]["quantities"][0]["total"] == result.budget.isel(time=-1).total.values[0]


def test_the_settings_of_the_json_repeat_the_run(result: Result, data: dict[str, Any]) -> None:
    again = Experiment().update(data["settings"]).run()
    assert again.summary.equals(result.summary)
    assert Experiment().update(data["changed"]).to_dict() == result.experiment.to_dict()


def test_of_a_log_the_json_has_its_gaps_and_says_what_is_unknown(log: Result) -> None:
    found = strict(log.to_json())
    assert (found["kind"], found["seed"], found["nees"]) == ("log", None, None)
    assert found["gaps"] == {"filled": [], "breaks": []}
    assert "true biases" in found["missing"]["coverage"]
    assert "mean" in found["summary"][0]


def test_there_is_no_nan_even_where_nothing_is_known() -> None:
    blind = simulated()
    blind.set("sensors.gps.outages", [(0.0, 1000.0)])
    found = strict(blind.run().to_json())
    assert found["nis"] is None
    assert found["verdict"]["consistent"] in (None, False)


def test_a_run_of_the_gallery_names_neither_its_fault_nor_its_seed() -> None:
    fault = FAULTS["latency"]
    made = FaultyExperiment(fault)
    made.update({"mission": "los_angeles", "seed": 4711, "trajectory": {"imu_rate": 50.0}})
    text = made.run().to_json()
    assert fault.title not in text
    assert "4711" not in text
    assert strict(text)["seed"] is None


def test_the_document_describes_the_fields_of_an_ensemble() -> None:
    experiment = simulated()
    experiment.set("sensors.gps.outages", [(40.0, 60.0)])
    ensemble = run_ensemble(experiment, [4, 5, 9])
    found = strict(json.dumps(ensemble.to_dict(), allow_nan=False))
    are_described(
        "An ensemble",
        found,
        {"diverged[].seed", "diverged[].reason", "remarks[]", "wanted", "seconds", "out"},
    )
    assert found["seeds"] == [[4, 5], [9, 9]]
    assert [row["rms"] for row in found["errors"]] == list(ensemble.coverage["rms"])
    east = ensemble.errors.sel(quantity="position east")
    assert found["errors"][0]["fixes_rms"] == pytest.approx(float(np.sqrt((east.rms**2).mean())), rel=1e-9)
    assert found["errors"][0]["fixes_sigma"] == pytest.approx(
        float(np.sqrt((east.sigma**2).mean())), rel=1e-9
    )
    ends = [row["outage_end"] for row in found["errors"]]
    assert ends == pytest.approx(list(np.sqrt(np.mean(ensemble.at_outage_ends[:, 0] ** 2, axis=0))))
    assert found["horizontal"]["outage_end"] == pytest.approx(np.hypot(*ends[:2]))
    assert found["verdict"]["headline"] == ensemble.verdict.headline


def test_the_document_describes_the_fields_of_a_sweep() -> None:
    swept = simulated().sweep({"navigator.q_scale": [0.1, 1.0], "navigator.model": ["phi", "nonlinear"]}, 2)
    found = strict(json.dumps(swept.to_dict(), allow_nan=False))
    are_described("A sweep", found, {"refused[]", "wanted", "done", "remarks[]", "seconds", "out"})
    last = found["points"][-1]
    assert last["values"] == {"navigator.q_scale": 1.0, "navigator.model": "nonlinear"}
    there = swept.dataset.sel(q_scale=1.0, model="nonlinear")
    vector = (there.rms.sel(quantity=["position east", "position north", "position up"]) ** 2).sum("quantity")
    assert last["position"]["rms"] == pytest.approx(float(np.sqrt(vector.mean())), rel=1e-12)
    assert last["nees"] == {"mean": pytest.approx(float(there.nees.mean())), "expected": 15}
    assert Experiment().update(found["settings"]).to_dict() == simulated().to_dict()
