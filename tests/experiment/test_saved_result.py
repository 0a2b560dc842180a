"""Saved results: what a file says of itself repeats its run to the last bit, in another interpreter."""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from sensor_logs import tables, write

import lab
from lab import Experiment, Result, ResultError, export_track, open_result
from lab.navigation.solution import HISTORIES
from lab.run.provenance import RESULT, VERSIONS, facts_block, find_facts

WRITERS: dict[str, Callable[[Result, Path], Any]] = {
    "run.nc": lambda result, path: result.to_netcdf(path),
    "folder": lambda result, path: result.to_csv(path),
    "run.json": lambda result, path: path.write_text(result.to_json(), "utf-8"),
    "run.html": lambda result, path: result.report(path),
    **{f"run{ending}": export_track for ending in (".kml", ".gpx", ".csv", ".csv.gz", ".tum", ".pos")},
    "run.solution.csv": export_track,
    **{f"fig{end}": lambda result, path: result.plot.errors().save(path) for end in (".pdf", ".svg", ".png")},
}
"""All formats that have room for what made them, but parquet, which needs another package."""
AGAIN = """
import sys
import numpy as np
from lab import open_result
from lab.navigation.solution import HISTORIES
for path in sys.argv[1:]:
    saved = open_result(path)
    again = saved.run()
    assert saved.is_repeated_by(again), path
    np.savez(path + ".npz", **{name: getattr(again.solution_arrays, name) for name in HISTORIES})
"""


def experiment() -> Experiment:
    return Experiment(mission="los_angeles", seed=3).update(
        {
            "trajectory.imu_rate": 50.0,
            "navigator.q_scale": 0.1 + 0.2,  # 0.30000000000000004 needs all its digits
            "sensors.gps.outages": [(40.0, 50.0)],
        }
    )


@pytest.fixture(scope="module")
def result() -> Result:
    return experiment().run()


@pytest.fixture(scope="module")
def files(result: Result, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("files")
    for name, write_file in WRITERS.items():
        write_file(result, folder / name)
    return {name: folder / name for name in WRITERS}


def fresh(script: str, *arguments: str | Path) -> str:
    """Return what a fresh interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def same_bits(result: Result, path: Path) -> None:
    with np.load(f"{path}.npz") as again:
        for name in HISTORIES:
            assert np.array_equal(again[name], getattr(result.solution_arrays, name), equal_nan=True), name


def test_a_fresh_interpreter_repeats_the_run_of_every_format(result: Result, files: dict[str, Path]) -> None:
    fresh(AGAIN, *files.values())
    for path in files.values():
        same_bits(result, path)


@pytest.mark.proof
@pytest.mark.parametrize("name", WRITERS)
def test_so_does_one_of_its_own_for_each(result: Result, files: dict[str, Path], name: str) -> None:
    """Nothing is kept from the file before, as the stages of a run are."""
    fresh(AGAIN, files[name])
    same_bits(result, files[name])


def test_parquet_repeats_its_run(result: Result, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    export_track(result, tmp_path / "run.parquet")
    assert open_result(tmp_path / "run.parquet").experiment.to_dict() == result.experiment.to_dict()


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_has_all_settings_versions_date_and_seed(
    result: Result, files: dict[str, Path], name: str
) -> None:
    saved = open_result(files[name])
    assert saved.experiment.to_dict() == result.experiment.to_dict()
    facts = saved.facts
    assert (facts["schema"], facts["schema_version"], facts["seed"]) == (RESULT, 1, 3)
    assert facts["recording"] == result.mission.content_hash
    assert facts["versions"]["numpy"] == np.__version__
    assert {"ins-lab", "scipy", "numba", "python"} <= facts["versions"].keys()
    assert str(facts["made"]).endswith("Z")
    assert saved.other_versions == {}
    assert "seed 3" in repr(saved)


def test_a_netcdf_file_says_where_its_data_are(result: Result, files: dict[str, Path]) -> None:
    with xr.open_dataset(files["run.nc"]) as opened:
        assert not opened.data_vars
        assert 'group="NAME"' in opened.attrs["how_to_open"]
        groups = opened.attrs["groups"].split(", ")
    assert groups == list(result.datasets())
    for group in groups:
        with xr.open_dataset(files["run.nc"], group=group) as one:
            assert one.data_vars
    saved = open_result(files["run.nc"])
    xr.testing.assert_equal(saved.errors, result.errors)
    table = open_result(files["folder"]).errors
    np.testing.assert_allclose(table["position east [m]"], result.errors.position[:, 0], rtol=1e-11)
    with pytest.raises(AttributeError, match="it has truth, solution"):
        _ = saved.nonsense


def test_many_runs_are_repeated_by_their_files(tmp_path: Path) -> None:
    base = experiment()
    sweep = base.sweep({"navigator.smoother": [False, True], "navigator.latency": [None, 0.1]}, 2)
    one = sweep.sel(smoother="True")
    for ending, write_file in ((".nc", sweep.to_netcdf), (".csv", sweep.to_csv)):
        write_file(tmp_path / f"sweep{ending}")
    (tmp_path / "sweep.json").write_text(json.dumps(sweep.to_dict()), "utf-8")
    one.to_netcdf(tmp_path / "part.nc")
    ensemble = lab.run_ensemble(base, [7, 8, 11])
    ensemble.to_netcdf(tmp_path / "runs.nc")
    (tmp_path / "runs.json").write_text(json.dumps(ensemble.to_dict()), "utf-8")
    script = """
import sys
from lab import open_result
for path in sys.argv[1:]:
    saved = open_result(path)
    print(saved.kind, saved.is_repeated_by(saved.run()))
"""
    names = ("sweep.nc", "sweep.csv", "sweep.json", "part.nc", "runs.nc", "runs.json")
    said = fresh(script, *(tmp_path / name for name in names))
    assert said.split("\n")[:-1] == ["sweep True"] * 4 + ["ensemble True"] * 2
    # A part is a part: its file does not run the rest.
    assert open_result(tmp_path / "part.nc").run().dataset.sizes["smoother"] == 1


def test_the_figures_of_a_sweep_have_their_units() -> None:
    sweep = experiment().sweep({"navigator.q_scale": [0.5, 1.0]}, 1)
    assert {sweep.dataset[name].attrs["units"] for name in ("nees", "nis", "seed")} == {"1"}
    assert sweep.dataset.horizontal_95.attrs["units"] == "m"
    heading = sweep.of("attitude heading")
    assert {one.attrs["units"] for one in heading.data_vars.values()} == {"°"}
    np.testing.assert_array_equal(heading.rms, sweep.dataset.rms.sel(quantity="attitude heading"))
    with pytest.raises(ValueError, match="accepted are position east"):
        sweep.of("height")


def test_a_log_is_repeated_only_on_its_own_data(tmp_path: Path) -> None:
    folder = write(tmp_path / "drive", tables(60, 75), 'title = "Drive"')
    result = Experiment(mission=str(folder)).run()
    result.to_netcdf(tmp_path / "run.nc")
    saved = open_result(tmp_path / "run.nc")
    assert "seed" not in saved.facts
    assert saved.is_repeated_by(saved.run())
    write(tmp_path / "drive", tables(60, 76), 'title = "Drive"')
    with pytest.raises(ResultError, match="another recording"):
        saved.run()


def test_a_mission_without_a_run_has_nothing_to_run(tmp_path: Path) -> None:
    export_track(lab.mission("montreal"), tmp_path / "path.kml")
    saved = open_result(tmp_path / "path.kml")
    assert (saved.kind, saved.facts["mission"]) == ("mission", "montreal")
    with pytest.raises(ResultError, match="a mission without a run"):
        saved.run()
    # Our own csv with remarks is still a flight.
    export_track(lab.mission("montreal"), tmp_path / "path.csv")
    assert Experiment(mission=str(tmp_path / "path.csv")).run().time.size


def test_an_own_algorithm_is_asked_for(result: Result, tmp_path: Path) -> None:
    facts = result.facts | {"algorithm": "mine"}
    (tmp_path / "run.tum").write_text(facts_block(facts, "# "), "utf-8")
    with pytest.raises(ResultError, match="navigated by mine"):
        open_result(tmp_path / "run.tum").run()


def test_files_of_version_0_1_still_open(result: Result, tmp_path: Path) -> None:
    """Their settings: an attribute, a file beside the tables, a field, and the end of a report."""
    settings = result.experiment.to_toml()
    tree = xr.DataTree.from_dict({"/errors": result.errors})
    tree.attrs |= {"title": "INS Lab: Los Angeles", "settings": settings}
    tree.to_netcdf(tmp_path / "run.nc")
    (tmp_path / "csv").mkdir()
    (tmp_path / "csv" / "settings.toml").write_text(settings, "utf-8")
    (tmp_path / "csv" / "errors.csv").write_text("time [s],position east [m]\n0,1\n1,2\n", "utf-8")
    old = {"schema": RESULT, "schema_version": 1, "settings": result.experiment.to_dict(), "seed": 3}
    (tmp_path / "run.json").write_text(json.dumps(old), "utf-8")
    page = f'<html><pre id="settings">{settings.replace("&", "&amp;")}</pre></html>'
    (tmp_path / "run.html").write_text(page, "utf-8")
    for name in ("run.nc", "csv", "run.json", "run.html"):
        saved = open_result(tmp_path / name)
        assert saved.experiment.to_dict() == result.experiment.to_dict()
        again = saved.run()
        assert np.array_equal(again.solution_arrays.position, result.solution_arrays.position)
        with pytest.raises(ResultError, match=r"since version 0\.2"):
            saved.is_repeated_by(again)
    assert open_result(tmp_path / "run.nc").errors.sizes == result.errors.sizes
    # Many runs open, too; their files do not say what was run.
    for group, kind in (("", "sweep"), ("runs", "ensemble"), ("outages", "outages")):
        tree = xr.DataTree.from_dict({f"/{group}": xr.Dataset({"nis": ("seed", [6.0])}, {"seed": [1]})})
        tree.attrs |= {"title": "many", "settings": settings}
        tree.to_netcdf(tmp_path / f"{kind}.nc")
        saved = open_result(tmp_path / f"{kind}.nc")
        assert (saved.kind, getattr(saved, group or "sweep").nis.item()) == (kind, 6.0)
        assert f"; {group or 'sweep'}>" in repr(saved)
        with pytest.raises(ResultError, match="does not say what was run"):
            saved.run()


def test_a_newer_file_is_refused_in_words(result: Result, files: dict[str, Path], tmp_path: Path) -> None:
    newer = result.facts | {"schema_version": VERSIONS[RESULT] + 1}
    newer["versions"] = newer["versions"] | {"ins-lab": "9.9.0"}
    (tmp_path / "run.tum").write_text(facts_block(newer, "# "), "utf-8")
    (tmp_path / "run.json").write_text(json.dumps(newer), "utf-8")
    with xr.open_datatree(files["run.nc"]) as tree:
        tree.load()
    tree.attrs["schema_version"] = VERSIONS[RESULT] + 1
    tree.to_netcdf(tmp_path / "run.nc")
    for name in ("run.tum", "run.json", "run.nc"):
        with pytest.raises(ResultError, match=r"newer lab.*version 2 of the form.*reads up to 1"):
            open_result(tmp_path / name)
    with pytest.raises(ResultError, match=r"ins-lab 9\.9\.0"):
        open_result(tmp_path / "run.json")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.nc", b"CDF\x05 nothing"),
        ("a.nc", b"\x89HDF\r\n\x1a\n" + bytes(200)),
        ("a.json", b"[" * 100_000),
        ("a.json", b'{"settings": 3}'),
        ("a.json", b'{"settings": {}, "schema": ["x"]}'),
        ("a.json", b'{"settings": {}, "schema_version": true}'),
        ("a.json", b'{"settings": {}, "schema": "ins-lab homework"}'),
        ("a.tum", b"# INS Lab: what made this file, as TOML\n# = =\n# INS Lab: end\n"),
        ("a.tum", b"# INS Lab: what made this file, as TOML\n# schema = 1\n"),
        ("a.csv.gz", gzip.compress(b"x" * 100, mtime=0)[:-9]),
        ("a.csv", b"\xff\xfe\x00"),
        ("a.kml", b"<kml/>"),
        ("a.html", b'<pre id="settings">= =</pre>'),
        ("a.pdf", b"%PDF-1.4 /Keywords (\\"),
        ("a.png", b"\x89PNG\r\n\x1a\n" + bytes(40)),
        ("a.sbet", bytes(136)),
        ("a.txt", b"text"),
    ],
)
def test_a_damaged_or_foreign_file_is_refused_in_words(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ResultError, match=name):
        open_result(tmp_path / name)
    with pytest.raises(FileNotFoundError, match="accepted are"):
        open_result(tmp_path / "missing.nc")


def test_settings_that_are_not_accepted_are_named(result: Result, tmp_path: Path) -> None:
    facts = result.facts | {"settings": {"navigator": {"nonsense": 1}}}
    (tmp_path / "run.tum").write_text(facts_block(facts, "# "), "utf-8")
    with pytest.raises(ResultError, match="nonsense"):
        open_result(tmp_path / "run.tum").run()


def test_a_hostile_file_takes_no_long_time(tmp_path: Path) -> None:
    """Many beginnings without an end: a search that begins anew at each takes minutes."""
    (tmp_path / "a.tum").write_text("# INS Lab: what made this file, as TOML\n" * 50_000, "utf-8")
    (tmp_path / "a.html").write_text('<pre id="settings">x' * 500_000, "utf-8")
    begun = time.process_time()
    for name in ("a.tum", "a.html"):
        with pytest.raises(ResultError, match=name):
            open_result(tmp_path / name)
    assert time.process_time() - begun < 5


@pytest.mark.parametrize("sign", ["", "# ", "% ", "//"])
@pytest.mark.parametrize("short", [False, True])
def test_facts_survive_any_sign_of_comments(sign: str, short: bool) -> None:
    facts = {"schema": RESULT, "text": 'a "b" # c\n  d\\', "table": {"x": [1.5, -0.0], "deep": {"y": True}}}
    assert find_facts(f"before\n{facts_block(facts, sign, short=short)}after\n") == facts
