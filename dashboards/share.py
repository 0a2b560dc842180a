"""Share: one menu for all that is passed on: link, command, Python, report, settings, data and results.

Of a run with something hidden, neither that nor its seed is in any of these.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import parse_qsl

import panel as pn
import param
from panel.custom import JSComponent

from dashboards.address import Address
from dashboards.exchange import (
    figures_file,
    gpx_file,
    json_file,
    kml_file,
    netcdf,
    report_file,
    seen_csv,
    zipped_csv,
)
from dashboards.pages.base import Page
from dashboards.pages.missions.job import Job
from dashboards.query import query
from dashboards.session import Session
from dashboards.upstream.components import send_to_browser
from lab.base.progress import Progress
from lab.base.result_files import csv_blocks
from lab.experiment.experiment import Experiment
from lab.experiment.json_form import changed_settings
from lab.experiment.result import Result
from lab.views.figures import TimeAxis

NO_REPETITION = "Some settings of this run are hidden: only its lesson or homework repeats it."
HIDES = "None of these contains what the run hides, or its seed."
LACKS = "The held results do not fit into a link of 8 kB. The settings file has them."
NO_RESULT = "There is no result yet."

_STYLE = Path(__file__).with_name("share_menu.css")
_PLACE = """
:host { position: fixed !important; right: 12px; bottom: 72px; z-index: 1300;
        width: min(440px, 92vw) !important;
        background: color-mix(in srgb, var(--mui-palette-background-paper, #ffffff) 92%, #808080);
        border-radius: 6px;
        filter: drop-shadow(0 2px 8px rgba(0, 0, 0, .45)); }
"""
"""The progress of a file, over the page: nothing is moved by it."""


class Kind(NamedTuple):
    """A file of the menu.

    Attributes
    ----------
    label, ending : str
        Its name in the menu, and the ending of its file.
    write : callable
        Writes it.
    """

    label: str
    ending: str
    write: Callable[[Result, Progress], bytes]


FILES = {
    "report": Kind("Report", "html", report_file),
    "figures": Kind("Figures for print (PDF)", "pdf", figures_file),
    "data": Kind("All data (csv)", "zip", zipped_csv),
    "netcdf": Kind("Result (netCDF)", "nc", netcdf),
    "json": Kind("Result (JSON)", "json", json_file),
    "kml": Kind("Path (KML)", "kml", kml_file),
    "gpx": Kind("Path (GPX)", "gpx", gpx_file),
}
COPIES = {"link": "Copy link", "command": "Copy as command", "python": "Copy as Python"}
ENTRIES = (
    *COPIES.items(),
    ("", ""),
    *((key, FILES[key].label) for key in ("report", "figures")),
    ("settings", "Settings file"),
    ("seen", "Data as seen (csv)"),
    *((key, FILES[key].label) for key in ("data", "netcdf", "json", "kml", "gpx")),
)
"""Keys and labels of the menu in its order; an empty one is a line between them."""


class ShareMenu(JSComponent):
    """A button with a menu. What is copied is copied in the browser, within the click.

    Parameters
    ----------
    act
        Called with "open" when the menu is opened, and with the key of a file.
    """

    entries: list[list[str]] = param.List([list(entry) for entry in ENTRIES], doc="Keys and labels.")
    told: dict[str, Any] = param.Dict(
        {"texts": {}, "withheld": {}, "note": "", "count": 0},
        doc="What is copied, why some entries are not to be had, a sentence below, and a count.",
    )
    asked: dict[str, Any] = param.Dict({}, doc="The last wish, and a count.")

    _esm = Path(__file__).with_name("share_menu.js")
    _stylesheets = [_STYLE.read_text("utf-8")]  # noqa: RUF012 - Panel's own

    def __init__(self, act: Callable[[str], None], **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]
        self.param.watch(lambda event: act(str(event.new.get("what", ""))), "asked")

    def give(self, name: str, content: bytes) -> None:
        """Give the browser a file; nothing of it is kept."""
        send_to_browser(self, [name, content])


class Share:
    """The menu of what is passed on of a session.

    Parameters
    ----------
    session
        The session.
    address
        Its address.
    main
        Where the progress of files is shown, from the first one on.
    seen
        Returns the visible page, and the visible stretch of time [s].

    Attributes
    ----------
    view : ShareMenu
        The button, for the header.
    """

    def __init__(
        self,
        session: Session,
        address: Address,
        main: pn.Column,
        seen: Callable[[], tuple[Page, tuple[float, float]]],
    ) -> None:
        self._session, self._address, self._main, self._seen = session, address, main, seen
        self._job: Job | None = None
        self.view = ShareMenu(self._act, margin=(6, 0), height=36)

    def close(self) -> None:
        """Write no more."""
        if self._job is not None:
            self._job.close()

    def _act(self, what: str) -> None:
        if what == "open":
            self._tell()
        elif what == "settings":
            experiment = self._session.experiment
            content = f"{self._address.held.lines}{experiment.to_toml()}"
            self.view.give(self._name(experiment, "toml"), content.encode())
        elif what == "seen":
            self._write_result("csv", partial(seen_csv, *self._seen()))
        elif what == "report":
            self._write_result(FILES[what].ending, partial(report_file, notes=self._session.notes))
        elif what in FILES:
            self._write_result(FILES[what].ending, FILES[what].write)

    def give_samples(self, axis: TimeAxis, event: param.parameterized.Event) -> None:
        """Give the browser the samples that a figure shows; a hand-made message may contain anything."""
        read = axis.samples.get(str(event.new.get("figure")))
        if read is not None:
            self._begin(
                str(event.new.get("name")), lambda _progress: "".join(csv_blocks(read())).encode("utf-8")
            )

    def _tell(self) -> None:
        """Give the browser what is copied, as the page is now."""
        experiment, withheld = self._session.experiment, dict[str, str]()
        texts = {"link": self._address.link}
        if experiment.hidden:
            withheld = dict.fromkeys(("command", "python"), NO_REPETITION)
        else:
            texts |= {"command": command_of(experiment), "python": python_of(experiment)}
        if self._session.result is None:
            withheld |= dict.fromkeys(("seen", *FILES), NO_RESULT)
        notes = (HIDES if experiment.hidden else "", LACKS if self._address.lacks_held else "")
        self.view.told = {
            "texts": texts,
            "withheld": withheld,
            "note": " ".join(filter(None, notes)),
            "count": self.view.told["count"] + 1,
        }

    def _write_result(self, ending: str, write: Callable[[Result, Progress], bytes]) -> None:
        result = self._session.result
        if result is not None:
            self._begin(self._name(result.experiment, ending), partial(write, result))

    def _begin(self, name: str, write: Callable[[Progress], bytes]) -> None:
        """Write a file, unless one is being written: people click again when they wait."""
        if self._job is not None and self._job.busy:
            return
        if self._job is None:
            self._job = Job(closeable=True)
            self._main.append(pn.Column(self._job.view, margin=0, stylesheets=[_PLACE]))

        def work(progress: Progress) -> bytes:
            try:
                return write(progress)
            except OSError as error:
                reason = error.strerror or str(error)
                raise ValueError(
                    f"The server could not write the file. The system says: {reason}."
                ) from error

        self._job.start(f"Writing {name}", work, partial(self.view.give, name))

    def _name(self, experiment: Any, ending: str) -> str:
        seed = "" if experiment.hidden else f"_{experiment.seed}"
        return f"{experiment.mission}{seed}.{ending}".replace(":", "_").replace("/", "_")


def command_of(experiment: Experiment) -> str:
    """Return the command that repeats a run, quoted for a shell.

    >>> command_of(Experiment().update({"navigator": {"q_scale": 0.1}}))
    'ins-lab run montreal --set navigator.q_scale=0.1'
    """
    words = ["ins-lab", "run", experiment.mission]
    for path, text in parse_qsl(query(experiment), keep_blank_values=True):
        if path == "seed":
            words += ["--seed", text]
        elif path != "mission":
            words += ["--set", f"{path}={text}"]
    return shlex.join(words)


def python_of(experiment: Experiment) -> str:
    """Return three lines of Python that repeat a run.

    >>> print(python_of(Experiment().update({"navigator": {"q_scale": 0.1}})))
    from lab import Experiment
    experiment = Experiment(mission='montreal').update({'navigator.q_scale': 0.1})
    result = experiment.run()
    """
    changed = changed_settings(experiment)
    first = {"mission": experiment.mission, **{name: changed[name] for name in ("seed",) if name in changed}}
    given = ", ".join(f"{name}={value!r}" for name, value in first.items())
    others = {path: value for path, value in changed.items() if path not in first}
    update = f".update({others!r})" if others else ""
    return (
        f"from lab import Experiment\nexperiment = Experiment({given}){update}\nresult = experiment.run()\n"
    )
