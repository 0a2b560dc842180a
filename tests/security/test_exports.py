"""Exports: names are text in them, which a viewer of KML takes for HTML; none has what is hidden."""

from __future__ import annotations

import gzip
import json
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import xarray as xr

from lab import Result, ResultError, export_track, open_result, run_ensemble
from lab.classroom.homework.homework import Homework
from lab.classroom.homework.scenario import Hidden, Scenario
from lab.classroom.homework.sealing import TeacherKey
from lab.experiment.experiment import Experiment
from lab.missions import Mission, MissionError
from lab.views.export import ENDINGS, gpx, kml
from lab.views.export.tracks import Tracks
from lab.views.mission_card import mission_html
from lab.views.paper_figure import ENDINGS as FIGURES
from lab.views.paper_figure import pages
from tests.security.test_hidden_settings import (
    HIDDEN_SEED,
    SECRET,
    SEED,
    SHOWN,
    WORDS,
    of_homework,
    of_the_gallery,
)

MARK = '<img src="x" onerror="alert(1)"></description>&lt;b&gt;]]>'


def test_no_tag_is_left_in_a_kml_once_it_is_read() -> None:
    document = ElementTree.fromstring(kml.text(Tracks(MARK, MARK, None, None, None)).encode())
    texts = [
        element.text or "" for element in document.iter() if element.tag.endswith(("name", "description"))
    ]
    assert len(texts) == 2
    assert all("<" not in text and "onerror" in text for text in texts)


def test_a_title_ends_no_element_of_a_gpx() -> None:
    document = ElementTree.fromstring(gpx.text(Tracks(MARK, MARK, None, None, None)).encode())
    assert [element.text for element in document.iter() if element.tag.endswith("name")] == [MARK]


def test_a_card_of_a_mission_has_no_tag_of_its_texts() -> None:
    card = mission_html(Mission(MARK, Path(MARK), MARK, MARK, MARK, MARK, MARK, (MARK,)))
    assert "No recording" in card
    assert "<img" not in card


def sealed_by_a_teacher() -> Experiment:
    """Return a homework with a key, of which a student takes another seed: that is sealed for the teacher."""
    key = TeacherKey.new()
    scenario = Scenario(
        key.name, "A title", SHOWN, ("navigator",), Hidden((), SECRET, HIDDEN_SEED), key.public
    )
    return Homework(scenario, "", key.public).experiment()


WRITERS: dict[str, Callable[[Result, Path], Any]] = {
    "run.nc": lambda result, path: result.to_netcdf(path),
    "folder": lambda result, path: result.to_csv(path),
    "run.json": lambda result, path: path.write_text(result.to_json(), "utf-8"),
    "run.html": lambda result, path: result.report(path),
    "all.pdf": lambda result, path: path.write_bytes(pages(result, lambda _words, _part: None)),
    **{f"run{ending}": export_track for ending in ENDINGS if ending != ".parquet"},
    **{
        f"{name}{ending}": lambda result, path: getattr(result.plot, path.stem)().save(path)
        for name, ending in (("errors", ".pdf"), ("ground_track", ".svg"), ("covariance", ".png"))
    },
}


def of_many_runs(experiment: Experiment, folder: Path) -> None:
    """Write a sweep and an ensemble in all their formats."""
    sweep = experiment.sweep({"navigator.r_scale": [0.5, 1.0]}, 2)
    sweep.to_netcdf(folder / "sweep.nc")
    sweep.to_csv(folder / "sweep.csv")
    sweep.plot().save(folder / "sweep.pdf")
    ensemble = run_ensemble(experiment, 3)
    ensemble.to_netcdf(folder / "runs.nc")
    forms = {"sweep.json": sweep.to_dict(), "runs.json": ensemble.to_dict()}
    for name, form in forms.items():
        (folder / name).write_text(json.dumps(form), "utf-8")


def contents(path: Path) -> Iterator[bytes]:
    """Iterate over all that a file contains: its bytes, and what is compressed in it."""
    content = path.read_bytes()
    yield content
    if path.suffix == ".gz":
        yield gzip.decompress(content)
    for found in re.finditer(rb"stream\r?\n(.*?)\r?\nendstream", content, re.S):  # of a PDF
        with suppress(zlib.error):
            yield zlib.decompress(found[1])
    if path.suffix == ".nc":
        with xr.open_datatree(path) as tree:
            yield repr([(leaf.attrs, leaf.to_dict()) for leaf in tree.subtree if leaf.sizes]).encode()
            yield repr(tree.attrs).encode()


WITH_SETTINGS = ("run.nc", "folder", "run.json", "run.html", "run.kml")
"""Of the writers, those whose files have settings, or names."""


@pytest.mark.parametrize(
    ("made", "writers"),
    [
        pytest.param(of_homework, WITH_SETTINGS, id="homework", marks=pytest.mark.proof),
        pytest.param(of_the_gallery, WRITERS, id="gallery"),
        pytest.param(sealed_by_a_teacher, WITH_SETTINGS, id="teacher"),
    ],
)
def test_no_format_has_what_is_hidden_or_the_seed(
    made: Callable[[], Experiment], writers: Iterable[str], tmp_path: Path
) -> None:
    experiment = made()
    experiment.set("seed", SEED)
    experiment.set("navigator.q_scale", 0.5)
    result = experiment.run()
    for name in writers:
        WRITERS[name](result, tmp_path / name)
    endings = {".nc", ".json", ".html", ".csv", ".kml"}
    if writers is WRITERS:
        with suppress(MissionError):  # pyarrow is not installed
            export_track(result, tmp_path / "run.parquet")
        of_many_runs(experiment, tmp_path)
        endings |= {*FIGURES, ".gz"}
    numbers = [SEED, SEED + 1, HIDDEN_SEED, (HIDDEN_SEED + SEED - 1) % 2**32]
    binary = {number: (struct.pack("<q", number), struct.pack("<d", number)) for number in numbers}
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.suffix for path in files} >= endings
    for path in files:
        for text in contents(path):
            assert [word for word in WORDS if word.encode() in text] == [], path.name
            assert [one for one, forms in binary.items() if any(form in text for form in forms)] == [], path
    for name in writers:
        if name.endswith((".sbet", ".out")):
            continue
        saved = open_result(tmp_path / name)
        assert saved.sealed.split()[0] in {"homework", "gallery"}, name
        assert saved.experiment.navigator.q_scale == 0.5
        with pytest.raises(ResultError, match="is sealed"):
            saved.run()
