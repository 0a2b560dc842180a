"""Options: the options that several commands share, and the experiment they define."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli.app import CommandError, argument, option
from lab.missions import mission as find_mission
from lab.missions import missions as find_missions
from lab.missions.log_mission import is_log_folder

if TYPE_CHECKING:
    from distributed import Client

    from lab.experiment.experiment import Experiment
    from lab.navigation.algorithm import Algorithm

Mission = Annotated[
    str, argument("MISSION", "Name of a mission, its .toml file, a flight csv, or the folder of a log.")
]
Config = Annotated[Path | None, option("--config", "FILE.toml", "File with settings; --set overrides them.")]
Card = Annotated[
    str | None, option("--card", "NAME", "Sensors of a card, by name or .toml file; --set overrides them.")
]
Assumed = Annotated[
    bool,
    typer.Option(
        "--assumed/--no-assumed",
        help="Terms without a source in the card: typical of its grade, or off.",
    ),
]
Assignments = Annotated[list[str] | None, option("--set", "PATH=VALUE", "Sets one setting; may be repeated.")]
Seed = Annotated[int | None, option("--seed", "N", "Seed of all random draws.")]
_UNIT = "--unit", "COLUMN=UNIT", "Plane_Altitude=ft"
_STREAM_UNIT = "--unit", "QUANTITY=UNIT", "rate=deg/s"
_COLUMN = "--column", "HEADING=QUANTITY[UNIT]", "a1=force_x[g]"
"""Options of pairs: name, form, example."""


def _pairs(kind: tuple[str, str, str], text: str) -> Any:
    """Return an option of pairs, which may be repeated."""
    name, form, _ = kind
    return option(name, form, f"{text}; may be repeated.")


Units = Annotated[list[str] | None, _pairs(_UNIT, "Unit of a column, if the file states none or a wrong one")]
Columns = Annotated[
    list[str] | None,
    _pairs(
        _COLUMN,
        "What a column of a csv is, such as a1=force_x[g], az=-force_z[m/s²] or, for one that is not read, "
        "b=-",
    ),
]
StreamUnits = Annotated[
    list[str] | None, _pairs(_STREAM_UNIT, "Unit of a quantity in text lines, such as rate=deg/s")
]
StreamColumns = Annotated[
    list[str] | None,
    _pairs(_COLUMN, "What a column of text lines is, by its heading or its number, such as 4=force_x[g]"),
]
SampleRate = Annotated[
    float | None,
    option("--rate", "HZ", "Samples of the IMU per second, where nothing says their times; to count losses."),
]
AlgorithmFile = Annotated[
    str | None, option("--algorithm", "FILE.py:Name", "Your own algorithm; the file is executed.")
]
AlgorithmFiles = Annotated[
    list[str] | None,
    option(
        "--algorithm",
        "FILE.py:Name",
        "Your own algorithm beside the models; may be repeated. The file is executed.",
    ),
]
MissionFolder = Annotated[
    Path | None, option("--out", "FOLDER", "Folder for the mission.", "your own missions")
]
MOST_RUNS = 1_000_000
"""Most runs that a command takes."""
Seeds = Annotated[
    int, typer.Option("--seeds", min=1, max=MOST_RUNS, metavar="N", help="Number of runs, from --seed on.")
]
Workers = Annotated[
    int | None, option("--workers", "N", "Number of threads.", "one for each processor", min=1)
]
Fast = Annotated[
    bool,
    typer.Option("--fast", help="Propagate the covariance at 20 Hz: σ differs by some 0.1 %."),
]
Scheduler = Annotated[
    str | None,
    option(
        "--scheduler",
        "ADDRESS|FILE",
        "Run on a Dask cluster: the address of its scheduler, such as tcp://192.168.1.5:8786, or the "
        "file that it wrote.",
    ),
]
Force = Annotated[bool, typer.Option("--force", "--overwrite", help="Replace existing files.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table; > FILE.json keeps it.")]
Further = Annotated[
    str | None,
    option("--with", "PART,...", "What the JSON has besides, and takes longer: budget, identification."),
]
PARTS = ("budget", "identification")
"""What `--with` takes."""


def further_parts(text: str | None, as_json: bool) -> list[str]:
    """Return the parts that --with names.

    Raises
    ------
    CommandError
        If there is no such part, or no JSON for it.
    """
    names = [] if text is None else [name.strip() for name in text.split(",")]
    wrong = [name for name in names if name not in PARTS]
    if wrong:
        raise CommandError(f"--with {wrong[0][:60]}: accepted are {' and '.join(PARTS)}")
    if names and not as_json:
        raise CommandError("--with: needs --json; `ins-lab budget` and `ins-lab identify` print tables")
    return names


def experiment(
    mission: str,
    config: Path | None,
    card: str | None,
    assignments: Sequence[str] | None,
    seed: int | None,
    assumed: bool = True,
) -> Experiment:
    """Return the experiment of a command: file, then card, then --set, then the other options.

    Raises
    ------
    MissionError, SettingError, CommandError
        If the mission does not exist, a setting is not accepted, or --no-assumed is given without a card.
    """
    if card is None and not assumed:
        raise CommandError("--no-assumed: needs --card, whose assumed numbers it omits")
    mission = single_mission(mission)
    find_mission(mission)
    from lab import Experiment  # noqa: PLC0415 - takes a second

    chosen = Experiment() if config is None else Experiment.from_toml(config)
    if card is not None:
        from lab.sensors.cards import card as find_card  # noqa: PLC0415 - rarely needed

        find_card(card, assumed=assumed).load(chosen)
    chosen.set_texts(assignments or [])
    chosen.set("mission", mission)
    if seed is not None:
        chosen.set("seed", seed)
    return chosen


def algorithms(places: Sequence[str] | None) -> dict[str, Algorithm]:
    """Return the algorithms that --algorithm names, by name.

    Raises
    ------
    CommandError
        If one cannot be loaded.
    """
    if not places:
        return {}
    from lab.navigation.algorithm import load_algorithms  # noqa: PLC0415 - takes half a second

    try:
        return load_algorithms(places)
    except ValueError as error:
        raise CommandError(f"--algorithm {error}") from error


def algorithm(place: str | None) -> Algorithm | None:
    """Return the one algorithm that --algorithm names, if it does; see `algorithms`."""
    return next(iter(algorithms([place] if place else None).values()), None)


@contextlib.contextmanager
def cluster_of(scheduler: str | None) -> Iterator[Client | None]:
    """Yield a client of the scheduler that --scheduler names; None without one.

    Raises
    ------
    CommandError
        If Dask is not installed, or no scheduler answers.
    """
    if scheduler is None:
        yield None
        return
    with contextlib.ExitStack() as stack:
        try:
            from lab.experiment.ensembles.cluster import connected  # noqa: PLC0415 - imports Dask

            client = stack.enter_context(connected(scheduler))
        except ImportError as error:
            raise CommandError(
                f'--scheduler: needs Dask, which is not installed: pip install "ins-lab[cluster]" ({error})'
            ) from error
        except ValueError as error:
            raise CommandError(f"--scheduler {error}") from error
        yield client


def single_mission(mission: str) -> str:
    """Return the mission in a named folder; for a log, the folder itself."""
    folder = Path(mission)
    if not mission or not folder.is_dir() or mission in find_missions() or is_log_folder(folder):
        return mission
    inside = [str(path) for path in sorted(folder.glob("*.toml"))]
    if len(inside) != 1:
        holds = ", ".join(inside) or "no mission"
        raise CommandError(
            f"{mission}: is a folder; accepted is one mission's .toml file (it holds {holds}), or a "
            "folder with a log: log.toml, or imu.csv and gnss.csv"
        )
    return inside[0]


def check_out(out: Path | None, force: bool, ending: str | tuple[str, ...], kind: str, option: str) -> None:
    """Check before the work that a file can be written.

    Parameters
    ----------
    out
        The file named.
    force
        Whether it may be replaced.
    ending, kind
        Required ending of the name, or several, and the kind of file.
    option
        The option that names it.

    Raises
    ------
    CommandError
        If the ending is wrong, the file exists, or its folder is not writable.
    """
    if out is None:
        return
    endings = (ending,) if isinstance(ending, str) else ending
    if out.suffix.lower() not in endings:
        json = "; --json prints JSON, and > FILE.json keeps it" if out.suffix.lower() == ".json" else ""
        words = " or ".join(endings)
        raise CommandError(f"{option} {out}: accepted is the name of {kind}, ending in {words}{json}")
    if out.is_dir() or (out.exists() and not force):
        raise CommandError(f"{option} {out}: exists already; name another file, or replace it with --force")
    if not out.parent.is_dir():
        raise CommandError(f"{option} {out}: there is no folder {out.parent}")
    if not os.access(out.parent, os.W_OK):
        raise CommandError(f"{option} {out}: the folder {out.parent} is not writable")


def corrections(units: Sequence[str] | None, columns: Sequence[str] | None) -> dict[str, str]:
    """Return what --unit and --column say, by column.

    Raises
    ------
    CommandError
        If one is not accepted.
    """
    return _read_pairs(_UNIT, units) | _read_pairs(_COLUMN, columns)


def check_rate(rate: float | None) -> None:
    """Check --rate.

    Raises
    ------
    CommandError
        If it is not accepted.
    """
    from lab.data.streams.capture import RATES  # noqa: PLC0415 - help does not need it

    if rate is not None and not RATES[0] <= rate <= RATES[1]:
        raise CommandError(f"--rate {rate:g}: accepted are {RATES[0]:g} to {RATES[1]:g} Hz")


def stream_options(
    units: Sequence[str] | None, columns: Sequence[str] | None, rate: float | None
) -> dict[str, str]:
    """Return what --unit, --column and --rate say, as options of the address of a source.

    Raises
    ------
    CommandError
        If one is not accepted.
    """
    check_rate(rate)
    said = {"unit": _read_pairs(_STREAM_UNIT, units), "column": _read_pairs(_COLUMN, columns)}
    options = {
        name: ";".join(f"{key}={value}" for key, value in pairs.items())
        for name, pairs in said.items()
        if pairs
    }
    return options if rate is None else options | {"rate": f"{rate:g}"}


def _read_pairs(kind: tuple[str, str, str], texts: Sequence[str] | None) -> dict[str, str]:
    """Return the pairs that an option of pairs was given."""
    name, form, example = kind
    found = {}
    for text in texts or []:
        column, sign, said = text.rpartition("=")
        if not sign or not column.strip() or not said.strip():
            raise CommandError(f"{name} {text}: accepted is {form}, such as {example}")
        found[column.strip()] = said.strip()
    return found
