"""The command line, ``ins-lab``: missions, sensors, runs, flights, the dashboard.

Results go to standard output, everything else to standard error. What a person can put right is answered with
one message and exit code 2. Commands import what they need when they run, so that help appears at once.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import socket
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.missions import MissionError, broken_missions, fly_mission
from lab.missions import mission as find_mission
from lab.missions import missions as find_missions
from lab.settings import SettingError
from lab.terminal import Progress, spell_what_cannot_be_encoded, table

if TYPE_CHECKING:
    from lab.experiment import Experiment
    from lab.missions import Mission
    from lab.result import Result


_NO_ADDRESS = "--address {}: is not an address of this computer, such as 127.0.0.1 or localhost"


class CommandError(ValueError):
    """A command that cannot be carried out as given; the message says what is accepted."""


class Commands(typer.core.TyperGroup):
    """The commands, answering whatever a person can put right with a message instead of a traceback."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by its name."""
        command = super().get_command(ctx, cmd_name)
        if command is None and not ctx.resilient_parsing:
            raise CommandError(
                f"there is no command {cmd_name!r}; accepted: {', '.join(self.list_commands(ctx))}"
            )
        return command

    def invoke(self, ctx: Any) -> Any:
        """Carry out the command."""
        try:
            return super().invoke(ctx)
        except (CommandError, MissionError, SettingError) as error:
            print(f"ins-lab: {error}", file=sys.stderr)
            raise typer.Exit(2) from error
        except OSError as error:
            if error.filename is None:  # such as a closed pipe
                raise
            print(f"ins-lab: {error.filename}: {error.strerror}", file=sys.stderr)
            raise typer.Exit(2) from error


app = typer.Typer(
    name="ins-lab",
    cls=Commands,
    invoke_without_command=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="""\b
Examples:
  ins-lab missions
  ins-lab run montreal
  ins-lab run montreal --set sensors.gyro.noise_density=0.02 --seed 7
  ins-lab budget montreal
  ins-lab cards
  ins-lab serve""",
)

Seed = Annotated[
    int | None, typer.Option("--seed", metavar="N", help="Seed of all random draws.", show_default=False)
]
Force = Annotated[bool, typer.Option("--force", "--overwrite", help="Replace what exists.")]
AsJson = Annotated[bool, typer.Option("--json", help="JSON instead of a table.")]


def main() -> None:
    """Run the command line with the arguments of the process."""
    spell_what_cannot_be_encoded()
    app()


@app.callback()
def ins_lab(
    ctx: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
) -> None:
    """INS Lab: fly a mission, simulate the sensors, navigate, and see how good the solution is, and why."""
    if version:
        from importlib.metadata import version as installed  # noqa: PLC0415 - rarely needed

        print(f"ins-lab {installed('ins-lab')}")
    elif ctx.invoked_subcommand is None:
        print(ctx.get_help())


@app.command("missions")
def list_missions(as_json: AsJson = False) -> None:
    """List the missions there are: those that ship, and your own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those left out are listed below
        found = find_missions()
    readable = [entry for entry in found.values() if _readable(entry)]
    for reason in broken_missions().values():
        print(f"ins-lab: mission left out: {reason}", file=sys.stderr)
    if as_json:
        print(json.dumps([_mission_facts(entry) for entry in readable], indent=2))
        return
    rows = [(entry.name, entry.title, f"{entry.duration:.1f} s", entry.origin) for entry in readable]
    print(table(("name", "title", "duration", "origin"), rows, right={2}))


@app.command(
    epilog="""\b
Examples:
  ins-lab run montreal
  ins-lab run los_angeles --seed 3 --out run.nc
  ins-lab run my_flight.csv --set navigator.r_scale=0.01 --json
  ins-lab run montreal --set "sensors.gps.outages=[[60, 90]]"
  ins-lab run montreal --card ADIS16470
A FILE.toml holds the same settings in tables, such as
  [sensors.gyro]
  noise_density = 0.02"""
)
def run(
    mission: Annotated[
        str,
        typer.Argument(
            metavar="MISSION", help="Name of a mission, its .toml file, or a flight csv.", show_default=False
        ),
    ],
    config: Annotated[
        Path | None,
        typer.Option(
            "--config", metavar="FILE.toml", help="Settings, before those of --set.", show_default=False
        ),
    ] = None,
    card: Annotated[
        str | None,
        typer.Option(
            "--card",
            metavar="NAME",
            help="Sensors of a card, by name or .toml file; before --set.",
            show_default=False,
        ),
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="One setting; may be repeated.", show_default=False),
    ] = None,
    seed: Seed = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE.nc", help="Write the whole result as netCDF.", show_default=False
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Navigate a mission; show how large the errors are, and whether the filter knows."""
    mission = _single(mission)
    find_mission(mission)
    _check_out(out, force)
    experiment = _experiment(mission, config, assignments or [], seed, card)
    # Only the answer goes to standard output, whatever a library prints.
    with contextlib.redirect_stdout(sys.stderr), Progress(mission) as progress:
        try:
            result = experiment.run(progress)
        except (MissionError, SettingError):  # these name what is wrong themselves
            raise
        except ValueError as error:
            raise CommandError(f"{mission}: {error}") from error
    if out is not None:
        try:
            result.to_netcdf(out, overwrite=force)
        except OSError as error:
            raise CommandError(f"--out {out}: cannot be written: {error.strerror or error}") from error
    if as_json:
        print(json.dumps(_answer(experiment, result, out), indent=2))
    else:
        from lab.verdict_answers import verdict_text  # noqa: PLC0415 - takes a second

        print(_summary_table(result))
        print(f"\n{verdict_text(result.verdict)}")


@app.command(
    epilog="""\b
Examples:
  ins-lab compare montreal
  ins-lab compare montreal --models phi,psi --seeds 20
  ins-lab compare los_angeles --set navigator.attitude_sigma=20 --json
Every model gets the same flights: same sensors, same draws. Errors are root mean squares over all runs; NEES
and NIS stand beside what they should be; the time is that of the navigator for one flight."""
)
def compare(
    mission: Annotated[
        str,
        typer.Argument(
            metavar="MISSION", help="Name of a mission, its .toml file, or a flight csv.", show_default=False
        ),
    ],
    models: Annotated[
        str | None,
        typer.Option(
            "--models",
            metavar="NAME,...",
            help="Error models, by commas; all by default.",
            show_default=False,
        ),
    ] = None,
    seeds: Annotated[int, typer.Option("--seeds", min=1, metavar="N", help="Runs with each model.")] = 1,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config", metavar="FILE.toml", help="Settings, before those of --set.", show_default=False
        ),
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="One setting; may be repeated.", show_default=False),
    ] = None,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Compare error models on the same flights: errors, consistency, time, verdict."""
    mission = _single(mission)
    find_mission(mission)
    experiment = _experiment(mission, config, assignments or [], seed)
    from lab import comparison, verdict_answers  # noqa: PLC0415 - takes a second

    names = None if models is None else [name.strip() for name in models.split(",")]
    with contextlib.redirect_stdout(sys.stderr), Progress(mission) as progress:
        try:
            rows = comparison.compare(experiment, names, seeds, progress)
        except (MissionError, SettingError):  # these name what is wrong themselves
            raise
        except ValueError as error:
            raise CommandError(f"{mission}: {error}") from error
    if as_json:
        print(json.dumps(verdict_answers.comparison_json(rows), indent=2))
    else:
        print(verdict_answers.comparison_table(rows))


@app.command(
    "budget",
    epilog="""\b
Examples:
  ins-lab budget montreal
  ins-lab budget montreal --set navigator.r_scale=100
  ins-lab budget los_angeles --at 60 --json
The columns are 1σ of all three components together, and the part of the variance. The total is that of the
errors, be the filter right or wrong; what it believes itself, and every component, is in the JSON.""",
)
def error_budget(
    mission: Annotated[
        str,
        typer.Argument(
            metavar="MISSION", help="Name of a mission, its .toml file, or a flight csv.", show_default=False
        ),
    ],
    config: Annotated[
        Path | None,
        typer.Option(
            "--config", metavar="FILE.toml", help="Settings, before those of --set.", show_default=False
        ),
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="One setting; may be repeated.", show_default=False),
    ] = None,
    seed: Seed = None,
    at: Annotated[
        float | None,
        typer.Option("--at", metavar="TIME", help="When, in seconds.", show_default="the end"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show what each source of error contributes to the errors of a mission's solution."""
    from lab.analysis.budget import budget_json, budget_text  # noqa: PLC0415 - takes a second

    mission = _single(mission)
    find_mission(mission)
    experiment = _experiment(mission, config, assignments or [], seed)
    with contextlib.redirect_stdout(sys.stderr), Progress(mission) as progress:
        try:
            result = experiment.run(progress)
            _check_time(at, float(result.time[-1]))
            dataset = result.budget
        except (CommandError, MissionError, SettingError):  # these name what is wrong themselves
            raise
        except ValueError as error:
            raise CommandError(f"{mission}: {error}") from error
    if as_json:
        facts = {"mission": experiment.mission, "seed": experiment.seed, **budget_json(dataset, at)}
        print(json.dumps(facts, indent=2, ensure_ascii=False))
    else:
        print(budget_text(dataset, at))


@app.command(
    epilog="""\b
Examples:
  ins-lab fly montreal
  ins-lab fly montreal --seed 12 --out my_missions"""
)
def fly(
    mission: Annotated[
        str,
        typer.Argument(
            metavar="MISSION",
            help="Name of a mission with a flight plan, or its .toml file.",
            show_default=False,
        ),
    ],
    seed: Annotated[
        int | None,
        typer.Option("--seed", metavar="N", help="Seed of the turbulence.", show_default="the plan's own"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FOLDER", help="Where the mission is written.", show_default="your own missions"
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Fly a mission's plan again in JSBSim and record it.

    Needs JSBSim: pip install 'ins-lab[fly]'. The same plan and seed give the same flight, bit by bit.
    """
    with contextlib.redirect_stdout(sys.stderr), Progress(mission) as progress:
        flown = fly_mission(
            mission,
            seed=seed,
            folder=out,
            overwrite=force,
            progress=lambda fraction: progress("flying", fraction),
        )
    print(f"{flown.recording_path}: {flown.duration:.1f} s flown")


@app.command(
    "cards",
    epilog="""\b
Examples:
  ins-lab cards
  ins-lab cards ADIS16470
  ins-lab run montreal --card ADIS16470""",
)
def list_cards(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]", help="A card, by name or .toml file: all of it.", show_default=False
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the cards of real sensors there are, or show one with its sources and what is missing."""
    from lab import sensor_answers  # noqa: PLC0415 - takes half a second
    from lab.sensors.cards import card, cards  # noqa: PLC0415 - takes half a second

    if name is None:
        found = cards()
        print(sensor_answers.cards_json(found) if as_json else sensor_answers.cards_table(found))
    elif as_json:
        print(json.dumps(sensor_answers.card_json(card(name)), indent=2))
    else:
        print(sensor_answers.card_text(card(name)))


@app.command(
    epilog="""\b
Examples:
  ins-lab allan imu.csv
  ins-lab allan imu.csv --card my_imu.toml
  ins-lab allan ADIS16470 --seed 3
A log is a csv with the columns t_s, gx_rad_s, gy_rad_s, gz_rad_s, fx_m_s2, fy_m_s2, fz_m_s2."""
)
def allan(
    record: Annotated[
        str,
        typer.Argument(
            metavar="FILE.csv",
            help="Log of an IMU at rest; or a card, by name or .toml file, simulated at rest.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--card", metavar="OUT.toml", help="Write a card of the log.", show_default=False),
    ] = None,
    seed: Annotated[
        int,
        typer.Option("--seed", min=0, max=2**32 - 1, metavar="N", help="Seed of what is simulated."),
    ] = 1,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Fit white noise, bias instability and random walk to the Allan deviation of an IMU at rest."""
    from lab import sensor_answers  # noqa: PLC0415 - takes half a second
    from lab.analysis import rest  # noqa: PLC0415 - takes half a second
    from lab.sensors.cards import card as find_card  # noqa: PLC0415 - takes half a second
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - takes half a second

    is_log = record.lower().endswith(".csv")
    if out is not None:
        if not is_log:
            raise CommandError(f"--card {out}: a card is made of a log, not of {record}")
        _check_out(out, force, ".toml", "a card", "--card")
    try:
        card = None if is_log else find_card(record)
    except SettingError as error:
        hint = "" if record.lower().endswith(".toml") else ", or of a log, ending in .csv"
        raise CommandError(f"{error}{hint}") from error
    with Progress(record) as progress:
        progress("reading" if is_log else "simulating", 0.0)
        if card is None:
            records = rest.read_log(Path(record))
        else:
            records = rest.simulate(SensorSuite().update(card.settings()), seed)
        progress("fitting", 0.5)
        if as_json:
            answer = sensor_answers.noise_json(record, records)
        else:
            answer = sensor_answers.noise_table(records, card)
        if out is not None:
            sensor_answers.write_card(out, records, Path(record).name)
    print(answer)


@app.command(epilog="Everything stays on this computer unless you name another address.")
def serve(
    port: Annotated[
        int, typer.Option("--port", min=1, max=65535, metavar="PORT", help="Port of the page.")
    ] = 5006,
    address: Annotated[
        str, typer.Option("--address", metavar="ADDRESS", help="Address to listen on; 0.0.0.0 is all.")
    ] = "127.0.0.1",
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open the page.")] = False,
) -> None:
    """Serve the dashboard and open it where there is a screen."""
    _check_port(address, port)
    from dashboards import serve as serve_dashboard  # noqa: PLC0415 - takes a second

    serve_dashboard(port=port, address=address, show=not no_browser and _has_screen())


def _check_time(at: float | None, end: float) -> None:
    if at is not None and not 0 <= at <= end:
        raise CommandError(f"--at {at:g}: accepted is a time from 0 to {end:g} s, the end of the flight")


def _single(mission: str) -> str:
    """Return the mission itself where its folder is named."""
    if not Path(mission).is_dir() or mission in find_missions():
        return mission
    inside = [str(path) for path in sorted(Path(mission).glob("*.toml"))]
    if len(inside) != 1:
        holds = ", ".join(inside) or "no mission"
        raise CommandError(f"{mission}: is a folder; accepted is one mission's .toml file (it holds {holds})")
    return inside[0]


def _experiment(
    mission: str,
    config: Path | None,
    assignments: Sequence[str],
    seed: int | None,
    card: str | None = None,
) -> Experiment:
    from lab.experiment import Experiment  # noqa: PLC0415 - takes a second

    experiment = Experiment() if config is None else Experiment.from_toml(config)
    if card is not None:
        from lab.sensors.cards import card as find_card  # noqa: PLC0415 - rarely needed

        experiment.update({"sensors": find_card(card).settings()})
    for assignment in assignments:
        experiment.set_text(assignment)
    experiment.set("mission", mission)
    if seed is not None:
        experiment.set("seed", seed)
    return experiment


def _check_out(
    out: Path | None, force: bool, ending: str = ".nc", kind: str = "a netCDF file", option: str = "--out"
) -> None:
    if out is None:
        return
    if out.suffix.lower() != ending:
        raise CommandError(f"{option} {out}: accepted is the name of {kind}, ending in {ending}")
    if out.is_dir() or (out.exists() and not force):
        raise CommandError(f"{option} {out}: exists already; name another file, or replace it with --force")
    if not out.parent.is_dir():
        raise CommandError(f"{option} {out}: there is no folder {out.parent}")
    if not os.access(out.parent, os.W_OK):
        raise CommandError(f"{option} {out}: the folder {out.parent} is not writable")


def _answer(experiment: Experiment, result: Result, out: Path | None) -> dict[str, Any]:
    from lab.verdict_answers import verdict_json  # noqa: PLC0415 - takes a second

    rows = result.summary.rename(columns={"95 %": "p95"}).to_dict("records")
    return {
        "mission": experiment.mission,
        "seed": experiment.seed,
        "settings": experiment.to_dict(),
        "summary": [{str(key): _finite(value) for key, value in row.items()} for row in rows],
        "verdict": verdict_json(result.verdict),
        "out": None if out is None else str(out),
    }


def _finite(value: Any) -> Any:
    """Return the value as JSON has it, which knows neither NaN nor NumPy's numbers."""
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _summary_table(result: Result) -> str:
    summary = result.summary
    numbers = {column for column, kind in enumerate(summary.dtypes) if kind.kind == "f"}
    # Fixed decimals align; errors far below a millimetre, as without sensor noise, need powers of ten.
    form = ".3f" if summary["rms"].min() > 0.01 else ".2e"
    rows = [
        tuple(f"{cell:{form}}" if column in numbers else str(cell) for column, cell in enumerate(row))
        for row in summary.itertuples(index=False)
    ]
    return table(tuple(summary.columns), rows, right=numbers)


def _readable(entry: Mission) -> bool:
    try:
        return entry.duration > 0
    except MissionError as error:
        print(f"ins-lab: mission {entry.name} left out: {error}", file=sys.stderr)
        return False


def _mission_facts(entry: Mission) -> dict[str, Any]:
    return {
        "name": entry.name,
        "title": entry.title,
        "description": " ".join(entry.description.split()),
        "duration_s": entry.duration,
        "aircraft": entry.aircraft,
        "airport": entry.airport,
        "origin": entry.origin,
        "tags": list(entry.tags),
        "recording": str(entry.recording_path),
        "can_fly": entry.flight is not None,
    }


def _check_port(address: str, port: int) -> None:
    try:
        family, kind, _, _, where = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            if os.name == "posix":
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(where)
    except socket.gaierror as error:
        raise CommandError(_NO_ADDRESS.format(address)) from error
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            raise CommandError(_NO_ADDRESS.format(address)) from error
        reason = (error.strerror or str(error)).lower()
        raise CommandError(
            f"--port {port}: {reason} at {address}; name another, such as --port {_free_port()}"
        ) from error


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _has_screen() -> bool:
    return sys.platform in {"darwin", "win32"} or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
