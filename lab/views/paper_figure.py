"""Paper figure: the plots of a notebook as PDF, SVG or PNG for print, drawn with matplotlib.

>>> result.plot.errors().save("errors.pdf", width="88 mm")

HoloViews could draw with matplotlib itself, but has no opacity, colours and dashes there that were set for
Bokeh, so bands would cover the curves. Here, each element of a plot is drawn with its own options
(`lab.views.paper_panel`).

References
----------
HoloViews, *Applying Customizations*, on options for each backend,
https://holoviews.org/user_guide/Applying_Customizations.html
"""

from __future__ import annotations

import io
import re
import threading
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import holoviews as hv
import param

from lab.base.files.atomic_file import atomic_file
from lab.base.progress import Progress
from lab.base.result_files import refuse_existing
from lab.run.provenance import facts_block
from lab.views.paper_panel import LETTER, SIZE, Keys, PaperPanel, bokeh_options

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.experiment.result import Result

ENDINGS = (".pdf", ".svg", ".png")
"""Endings of the files that can be written."""
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72}
"""Units of a width [mm]."""
NARROW, WIDE = 88.0, 180.0
"""Width of one column and of two columns of most journals [mm], as Nature's and IEEE's."""
LEAST, MOST = 40.0, 500.0
"""Least and largest width and height of a figure [mm]: its words do not fit, or it does not fit on a page."""
PANEL = 40.0
"""Least width of a panel [mm], beside which there is another one: five numbers of 6.5 pt fit below it."""
PAGE = 235.0
"""Largest height that a figure takes by itself [mm]: that of the text on A4."""
FLAT, HIGH, SHAPE, FRAME = 17.0, 50.0, 0.5, 11.0
"""Least and largest height of a panel [mm], its height over its width, and the height of its title and
ticks [mm]."""
RASTER = 600
"""Resolution of a PNG file [dots per inch]: what journals ask for line drawings."""
HANDLE = 10.0
"""Width of what stands before a word of the legend, with the distance to the next one [mm]."""
STYLE: Any = {
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "svg.fonttype": "path",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": SIZE,
    "axes.titlesize": SIZE,
    "axes.labelsize": SIZE,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": SIZE,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "grid.linewidth": 0.3,
    "grid.color": "0.85",
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 8),
    "axes.titlepad": 3.0,
    "axes.labelpad": 2.0,
    "figure.facecolor": "white",
}
"""What matplotlib draws with: TrueType fonts in PDF, outlines in SVG, sizes in points."""

_WIDTH = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(mm|cm|in|pt)\s*")
_KEYWORDS = re.compile(rb"/Keywords \(((?:[^\\()]|\\.)*)\)", re.S)
_LOCK = threading.Lock()  # the style of matplotlib is one for the process


class _Saved(param.Parameterized):
    """What can be saved as a figure for a paper."""

    made_by = param.Callable(None, doc="Returns what made the figures; see `lab.run.provenance`.")

    def save(
        self,
        path: str | Path,
        width: str | None = None,
        *,
        height: str | None = None,
        columns: int | None = None,
        overwrite: bool = False,
    ) -> None:
        """Write these plots as a figure for print.

        Fonts are embedded (TrueType in PDF, outlines in SVG). `lab.open_result` reads what made the figure.

        Parameters
        ----------
        path
            Ends with ``.pdf``, ``.svg`` or ``.png`` (600 dots per inch).
        width
            Such as ``"88 mm"``, ``"8.8 cm"``, ``"3.5 in"``, ``"252 pt"``; by default 88 mm for one plot, and
            180 mm for several.
        height
            Likewise; by default what the panels need.
        columns
            Number of panels side by side; by default as many as can be read.
        overwrite
            True replaces an existing file.

        Raises
        ------
        FileExistsError
            If the file exists and `overwrite` is not given.
        FileNotFoundError
            If the folder does not exist.
        ValueError
            For another ending, or a size that is not accepted.
        """
        save(self, path, width, height=height, columns=columns, overwrite=overwrite)


class Layout(_Saved, hv.Layout):
    """Plots side by side that can be saved; HoloViews finds their options by the name of the class."""


class Overlay(_Saved, hv.Overlay):
    """One plot that can be saved; HoloViews finds its options by the name of the class."""


def register_backend() -> None:
    """Have HoloViews draw these with Bokeh as it draws its own; may be repeated."""
    registry = hv.Store.registry["bokeh"]
    registry |= {Layout: registry[hv.Layout], Overlay: registry[hv.Overlay]}


def millimetres(size: str, what: str) -> float:
    """Return a width or a height [mm].

    Raises
    ------
    ValueError
        If it is none, or is not accepted.
    """
    found = _WIDTH.fullmatch(size) if isinstance(size, str) else None
    if found is None:
        raise ValueError(
            f"{what} {str(size)[:40]!r}: accepted is a number with its unit ({', '.join(MILLIMETRES)}), such "
            f'as "{NARROW:g} mm"'
        )
    length = float(found[1]) * MILLIMETRES[found[2]]
    if not LEAST <= length <= MOST:
        raise ValueError(f"{what} {size!r}: accepted is {LEAST:g} mm to {MOST:g} mm")
    return length


def check_name(path: Path) -> None:
    """Raise `ValueError` if a figure cannot be written under a name."""
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"{path}: accepted are names ending in {', '.join(ENDINGS)}")


def save(
    drawn: _Saved,
    path: str | Path,
    width: str | None = None,
    *,
    height: str | None = None,
    columns: int | None = None,
    overwrite: bool = False,
) -> None:
    """Write plots as a figure for print; see `Layout.save`."""
    path = Path(path)
    check_name(path)
    wide, tall = (
        None if one is None else millimetres(one, name)
        for one, name in ((width, "width"), (height, "height"))
    )
    panels = _panels(drawn)
    across = _columns(columns, wide or _natural_width(panels), len(panels), getattr(drawn, "_max_cols", 1))
    refuse_existing([path], overwrite)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: there is no folder {path.parent}")
    facts = {} if drawn.made_by is None else drawn.made_by()
    import matplotlib as mpl  # noqa: PLC0415 - takes 0.3 s to import, and the page does without

    with _LOCK, mpl.rc_context(STYLE), atomic_file(path) as file:
        figure = drawn_figure(panels, wide or _natural_width(panels), tall, across)
        kind = path.suffix.lower().removeprefix(".")
        figure.savefig(file, format=kind, dpi=RASTER, metadata=_metadata(facts, kind))


def pages(result: Result, progress: Progress) -> bytes:
    """Return all plots that a result has as a PDF: each on a page of its own size, drawn as by `Layout.save`.

    Parameters
    ----------
    result
        The result.
    progress
        Told the name and the part of the plots that are done.
    """
    import matplotlib as mpl  # noqa: PLC0415 - as above
    from matplotlib.backends.backend_pdf import PdfPages  # noqa: PLC0415 - as above

    names, buffer = result.plot.__dir__(), io.BytesIO()
    # Fonts are written at the end, in the style that holds then.
    with _LOCK, mpl.rc_context(STYLE), PdfPages(buffer, metadata=_metadata(result.facts, "pdf")) as file:
        for number, name in enumerate(names):
            progress(f"Drawing {name.replace('_', ' ')}", number / len(names))
            drawn = getattr(result.plot, name)()
            panels = _panels(drawn)
            width = _natural_width(panels)
            across = _columns(None, width, len(panels), getattr(drawn, "_max_cols", 1))
            file.savefig(drawn_figure(panels, width, None, across))
    return buffer.getvalue()


def _panels(drawn: _Saved) -> list[Any]:
    return [drawn] if isinstance(drawn, hv.Overlay) else list(drawn)


def _natural_width(panels: Sequence[Any]) -> float:
    """Return the width that plots have by themselves [mm]."""
    return WIDE if len(panels) > 1 else NARROW


def note(path: Path) -> str:
    """Return what a figure in PDF or PNG says of what made it, as text; empty without.

    Raises
    ------
    ValueError
        If a PNG file is damaged.
    """
    if path.suffix.lower() == ".pdf":
        found = _KEYWORDS.search(path.read_bytes())
        escaped = found[1].decode("latin-1") if found else ""
        return re.sub(
            r"\\(.)", lambda sign: {"n": "\n", "r": "\r"}.get(sign[1], sign[1]), escaped, flags=re.S
        )
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 - rarely needed

    try:
        with Image.open(path, formats=("PNG",)) as picture:
            return str(getattr(picture, "text", {}).get("ins-lab", ""))
    except (UnidentifiedImageError, Image.DecompressionBombError, SyntaxError) as error:
        raise ValueError(f"is no PNG file: {error}") from error


def _metadata(facts: Mapping[str, Any], kind: str) -> dict[str, str]:
    """Return what a file says of itself: a PDF in its keywords, SVG in its description."""
    creator = f"INS Lab {version('ins-lab')}"
    if not facts:
        return {"Software" if kind == "png" else "Creator": creator}
    # A PDF has two encodings of text; of ASCII, both are the same.
    text = re.sub(r"[^\x00-\x7f]", lambda sign: f"\\U{ord(sign[0]):08X}", f"\n{facts_block(facts)}")
    title = f"INS Lab: {facts.get('mission', '')}"
    if kind == "png":
        return {"Software": creator, "Title": title, "ins-lab": text}
    return {"Creator": creator, "Title": title, "Keywords" if kind == "pdf" else "Description": text}


def _columns(given: int | None, width: float, panels: int, own: int) -> int:
    if given is None:
        return max(1, min(int(width // PANEL), own, panels))
    if isinstance(given, bool) or not isinstance(given, int) or not 1 <= given <= panels:
        raise ValueError(f"columns {given!r}: accepted is a whole number from 1 to {panels}")
    if width / given < LEAST / 2:
        raise ValueError(
            f"columns {given}: {width / given:.0f} mm for each; accepted are at most "
            f"{int(width / (LEAST / 2))}"
        )
    return given


def drawn_figure(panels: Sequence[Any], width: float, height: float | None, across: int) -> Figure:
    """Return plots as a figure of matplotlib, which draws with `STYLE`.

    Parameters
    ----------
    panels
        The plots.
    width, height
        Its size [mm]; None for what the panels need.
    across
        Number of panels side by side.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - as above
    from matplotlib.layout_engine import ConstrainedLayoutEngine  # noqa: PLC0415 - as above

    rows = -(-len(panels) // across)
    options = [bokeh_options(one, "plot") for one in panels]
    is_map = any("data_aspect" in one for one in options)
    shape = 1.0 if is_map and len(panels) == 1 else SHAPE
    each = min(max(FLAT, shape * width / across), PAGE if is_map else HIGH) + FRAME
    tall = height or min(rows * each + FRAME, max(PAGE, rows * (FLAT + FRAME)))
    figure = Figure(
        figsize=(width / MILLIMETRES["in"], min(tall, MOST) / MILLIMETRES["in"]),
        layout=ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.02, wspace=0.02, hspace=0.01),
    )
    same_time = len({one.get("xlabel") for one in options}) == 1 and not is_map
    axes = figure.subplots(rows, across, squeeze=False, sharex="col" if same_time else "none")
    keys = Keys()
    for number, (panel, option) in enumerate(zip(panels, options, strict=True)):
        there = axes.flat[number]
        PaperPanel(there, keys, width / across).draw(panel, option)
        is_last = number + across >= len(panels)
        if same_time and not is_last:
            there.set_xlabel("")
        if same_time and is_last:
            there.tick_params(labelbottom=True)
    for there in axes.flat[len(panels) :]:
        there.set_visible(False)
    if entries := keys.entries():
        column = HANDLE + max(len(words) for _, words in entries) * LETTER
        figure.legend(
            [handle for handle, _ in entries],
            [words for _, words in entries],
            loc="outside upper center",
            ncols=max(1, min(len(entries), int(width // column))),
            frameon=False,
            handlelength=2.6,
            columnspacing=1.2,
        )
    return figure
