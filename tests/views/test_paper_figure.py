"""Figures for print: size, fonts, units, legend, and what remains of them in grey."""

from __future__ import annotations

import itertools
import re
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from lab import Experiment, Result, open_result
from lab.experiment.sweep import Sweep
from lab.views.cards import PLOTS
from lab.views.paper_figure import RASTER, STYLE, Layout, drawn_figure, millimetres, pages
from tests.cli.asking import ask, refused

SVG = "{http://www.w3.org/2000/svg}"


def small() -> Experiment:
    return Experiment(mission="los_angeles").update(
        {"trajectory.imu_rate": 50.0, "sensors.gps.outages": [(40.0, 50.0)]}
    )


@pytest.fixture(scope="module")
def result() -> Result:
    return small().run()


@pytest.fixture(scope="module")
def sweeps() -> dict[str, Sweep]:
    scales = {"navigator.q_scale": [0.1, 1.0, 10.0]}
    return {
        "one": small().sweep(scales, 3),
        "two": small().sweep({**scales, "navigator.r_scale": [0.5, 1.0, 4.0]}, 2),
        "texts": small().sweep(
            {"card": ["BMI088", "ADIS16470"], "navigator.correction": ["feedback", "feedforward"]}, 2
        ),
    }


def all_plots(result: Result, sweeps: dict[str, Sweep]) -> dict[str, Any]:
    drawn = {name: getattr(result.plot, name)() for name in PLOTS}
    return drawn | {name: sweep.plot() for name, sweep in sweeps.items()}


def laid_out(drawn: Any, width: float) -> Figure:
    """Return the figure of a plot after its layout."""
    panels = list(drawn) if isinstance(drawn, Layout) else [drawn]
    across = max(1, min(int(width // 40), getattr(drawn, "_max_cols", 1), len(panels)))
    with mpl.rc_context(STYLE):
        figure = drawn_figure(panels, width, None, across)
        FigureCanvasAgg(figure).draw()
    return figure


@pytest.mark.parametrize("width", [88.0, 180.0])
def test_every_plot_fits_has_units_and_survives_grey(
    result: Result, sweeps: dict[str, Sweep], width: float
) -> None:
    for name, drawn in all_plots(result, sweeps).items():
        figure = laid_out(drawn, width)
        size = figure.get_size_inches()
        assert size[0] * 25.4 == pytest.approx(width)
        assert 30 < size[1] * 25.4 <= 245, name
        axes = [one for one in figure.axes if one.get_visible()]
        assert len(axes) == (len(drawn) if isinstance(drawn, Layout) else 1)
        # Every word is inside, and none is smaller than journals print.
        edge = figure.bbox
        words = [text for one in axes for text in [*one.texts, one.title, one._left_title, one.xaxis.label]]
        words += [text for legend in figure.legends for text in legend.get_texts()]
        for text in (one for one in words if one.get_text()):
            box = text.get_window_extent()
            assert edge.x0 - 1 <= box.x0, (name, text)
            assert box.x1 <= edge.x1 + 1, (name, text)
            assert text.get_fontsize() >= 5.5
        for one in axes:
            words_of = one.get_title(loc="left") + one.get_ylabel() + one.get_xlabel()
            is_plain = re.search("NEES|NIS|Autocorrelation", words_of)
            assert is_plain or re.search(r"\[[^\]]+\]", one.get_title(loc="left") + one.get_ylabel()), name
            # In grey, curves that overlap differ by dashes, points by their markers.
            looks = [
                (line.get_linestyle(), str(line._dash_pattern), line.get_marker(), line.get_color())
                for line in one.get_lines()
                if line.get_linewidth() > 0.45 or line.get_marker() not in {"None", None}
            ]
            for first, second in itertools.combinations(set(looks), 2):
                is_sweep = "--" in {first[0], second[0]} or "_" in {first[2], second[2]}
                assert first[:3] != second[:3] or (is_sweep and first[0] == second[0]), (name, first, second)


def test_the_legend_names_each_look_once(result: Result, sweeps: dict[str, Sweep]) -> None:
    expected = {
        "errors": {"±3σ", "error"},
        "sensor_errors": {"±3σ", "estimate", "truth"},
        "ground_track": {"GPS fixes", "truth", "estimate"},
        "one": {"90 % of the runs", "over all seeds", "σ of the filter", "expected value"},
    }
    drawn = all_plots(result, sweeps)
    for name, words in expected.items():
        (legend,) = laid_out(drawn[name], 180.0).legends
        assert {text.get_text() for text in legend.get_texts()} == words
    (legend,) = laid_out(drawn["two"], 88.0).legends
    assert {"R scale 0.5", "R scale 1.0", "R scale 4.0"} <= {text.get_text() for text in legend.get_texts()}


def test_a_pdf_embeds_truetype_at_the_width_asked_for(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "errors.pdf"
    result.plot.errors().save(path, width="88 mm")
    content = path.read_bytes()
    (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)
    assert float(box[0]) / 72 * 25.4 == pytest.approx(88.0, abs=0.01)
    assert b"/Type3" not in content
    fonts = re.findall(rb"/FontFile2 (\d+) 0 R", content)
    assert fonts
    # The font is a TrueType file: it begins with version 1.0 and has glyphs.
    start = content.index(b"%s 0 obj" % fonts[0])
    stream = re.search(rb"stream\r?\n(.*?)\r?\nendstream", content[start:], re.S)
    assert stream is not None
    font = zlib.decompress(stream[1])
    assert font[:4] == b"\x00\x01\x00\x00"
    assert b"glyf" in font[:300]


def test_all_plots_are_the_pages_of_one_pdf_that_says_what_made_it(result: Result, tmp_path: Path) -> None:
    path, parts = tmp_path / "run.pdf", []
    path.write_bytes(pages(result, lambda words, part: parts.append((words, part))))
    content = path.read_bytes()
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) [\d.]+ \]", content)
    widths = [round(float(wide) / 72 * 25.4) for wide in boxes]
    assert widths == [88 if name == "ground_track" else 180 for name in PLOTS]
    assert [words.removeprefix("Drawing ").replace(" ", "_") for words, _ in parts] == list(PLOTS)
    assert [part for _, part in parts] == sorted(part for _, part in parts)
    assert b"/Type3" not in content
    assert open_result(path).experiment.to_dict() == result.experiment.to_dict()


def test_svg_has_outlines_and_png_its_resolution(result: Result, tmp_path: Path) -> None:
    result.plot.ground_track().save(tmp_path / "a.svg", width="3.5 in")
    root = ElementTree.parse(tmp_path / "a.svg").getroot()
    assert float(root.attrib["width"].removesuffix("pt")) == pytest.approx(252.0, abs=0.01)
    assert not list(root.iter(f"{SVG}text"))
    assert len(list(root.iter(f"{SVG}path"))) > 10
    result.plot.height().save(tmp_path / "a.png", width="120 mm", height="60 mm")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == pytest.approx((120 / 25.4 * RASTER, 60 / 25.4 * RASTER), abs=1)
        assert picture.info["dpi"] == pytest.approx((RASTER, RASTER), abs=1)
        # Grey keeps the ink apart from the paper, and the band apart from both.
        grey = np.asarray(picture.convert("L"))
    assert grey.min() < 40
    assert ((grey > 180) & (grey < 245)).mean() > 0.005


def test_what_is_not_accepted_is_said_before_anything_is_written(result: Result, tmp_path: Path) -> None:
    drawn = result.plot.errors()
    for name in ("a.jpg", "a", "a.pdf.gz"):
        with pytest.raises(ValueError, match=r"accepted are names ending in \.pdf, \.svg, \.png"):
            drawn.save(tmp_path / name)
    for width in ("88", "wide", "-88 mm", "nan mm", "1e9 mm", "88 km", "", "8" * 99, 88, "39 mm", "501 mm"):
        with pytest.raises(ValueError, match="accepted is"):
            drawn.save(tmp_path / "a.pdf", width=width)
    for columns in (0, 10, -1, True, 2.0, "2"):
        with pytest.raises(ValueError, match="columns"):
            drawn.save(tmp_path / "a.pdf", columns=columns)
    with pytest.raises(ValueError, match="at most 4"):
        drawn.save(tmp_path / "a.pdf", width="88 mm", columns=9)
    with pytest.raises(FileNotFoundError, match="no folder"):
        drawn.save(tmp_path / "no" / "a.pdf")
    assert not list(tmp_path.iterdir())
    drawn.save(tmp_path / "a.pdf", width="88 mm", columns=3)
    before = (tmp_path / "a.pdf").read_bytes()
    with pytest.raises(FileExistsError, match="overwrite=True"):
        drawn.save(tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes() == before
    assert [millimetres(one, "width") for one in ("8.8 cm", "3.5in", " 252 pt ")] == pytest.approx(
        [88, 88.9, 88.9]
    )


def test_matplotlib_is_loaded_only_for_a_figure_and_keeps_its_style(result: Result, tmp_path: Path) -> None:
    script = (
        "import sys, lab; lab.plots; from lab.views import paper_figure; print('matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
    before = dict(mpl.rcParams)
    result.plot.height().save(tmp_path / "a.pdf")
    assert dict(mpl.rcParams) == before


def test_the_command_writes_a_figure(tmp_path: Path) -> None:
    path = tmp_path / "path.svg"
    small_rate = ("--set", "trajectory.imu_rate=50")
    asked = ("figure", "los_angeles", *small_rate, "--plot", "ground_track", "--to", str(path))
    answer = ask(*asked, "--width", "60 mm")
    assert (answer.exit_code, answer.stdout.strip()) == (0, str(path))
    assert ElementTree.parse(path).getroot().attrib["width"].startswith("170.07")
    refused(ask(*asked), "exists already", "--force")
    to = ("--to", str(tmp_path / "b.pdf"))
    refused(ask("figure", "los_angeles", *to, "--plot", "nonsense"), "errors, covariance")
    refused(ask("figure", "los_angeles", *to, "--width", "88"), "--width", "88 mm")
    refused(ask("figure", "los_angeles", "--to", str(tmp_path / "b.eps")), ".pdf or .svg or .png")
