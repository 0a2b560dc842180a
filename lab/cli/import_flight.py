"""``ins-lab import``: a flight of a simulator or logger, checked, rebuilt and added to the missions."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli.app import CommandError, argument, option, print_json, working, writing
from lab.cli.options import AsJson, Columns, Force, Units, corrections

if TYPE_CHECKING:
    from lab.data.log.sensor_log import SensorLog
    from lab.data.rebuild.import_report import ImportReport
    from lab.missions.flight_import import FlightImport
    from lab.sensors.imu_errors import SensorNoise

EXAMPLES = """\b
Examples:
  ins-lab import Data.csv
  ins-lab import Data.txt --name lake --title "Round the lake"
  ins-lab import gps.csv imu.csv --name pair
  ins-lab import Data.csv --preview
  ins-lab import Data.csv --unit Plane_Altitude=m --set curve="air data" --set wind=none
  ins-lab import track.gpx --set vehicle=car
  ins-lab import flight.ulg --as log
  ins-lab import Accelerometer.csv Gyroscope.csv Location.csv --as log --vehicle car
  ins-lab import xsens_capture.bin --as log --axes x,-y,-z
  ins-lab import drive.csv --as log --axes y,x,-z --calibration sensor.toml
The format is detected from the content. --set takes curve, positions, time_stamps, longest_gap,
smoothing, smoothing_parameter, wind, wind_from, wind_speed, vehicle, start_latitude, start_longitude,
start_height and rate; the message about a refused value lists the accepted ones."""


class Kind(StrEnum):
    """What a file becomes: a flight recording, or a sensor log with the IMU and GPS data in it."""

    FLIGHT = "flight"
    LOG = "log"


def import_flight(
    files: Annotated[list[Path], argument("FILE...", "The files of one flight.")],
    name: Annotated[
        str | None,
        typer.Option("--name", help="Name of the mission.", show_default="the file's name"),
    ] = None,
    title: Annotated[str, typer.Option("--title", help="Title of the mission.", show_default=False)] = "",
    preview: Annotated[
        bool,
        typer.Option("--preview", help="Write a preview as an html file, and add nothing."),
    ] = False,
    units: Units = None,
    assignments: Annotated[
        list[str] | None, option("--set", "NAME=VALUE", "One setting of the import; may be repeated.")
    ] = None,
    kind: Annotated[
        Kind,
        typer.Option(
            "--as", help="Add the flight, to simulate sensors on it; or add the IMU and GPS data as a log."
        ),
    ] = Kind.FLIGHT,
    columns: Columns = None,
    axes: Annotated[
        str | None,
        option(
            "--axes",
            "X,Y,Z",
            "With --as log: the axes of the IMU that point forward, right and down, such as y,x,-z.",
            "found by gravity and motion",
        ),
    ] = None,
    vehicle: Annotated[
        str,
        typer.Option(
            "--vehicle",
            help="With --as log: kind of vehicle, if the file does not name it.",
            show_default=False,
        ),
    ] = "",
    calibration: Annotated[
        Path | None,
        option(
            "--calibration",
            "FILE.toml",
            "With --as log: constant errors of the device to remove, from ins-lab calibrate.",
        ),
    ] = None,
    card: Annotated[
        str | None,
        option(
            "--card",
            "NAME",
            "Card, by name or .toml file, whose noise the report compares with the recording's.",
        ),
    ] = None,
    implausible: Annotated[
        bool, typer.Option("--implausible", help="Add the flight even if it is implausible.")
    ] = False,
    save_profile: Annotated[
        str | None,
        option(
            "--save-profile",
            "NAME",
            "Keep what --column and --unit say, for all csv files with these headings.",
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Report on a recorded flight of any known format, rebuild it, and add it to your own missions."""
    from lab.data.rebuild.import_settings import ImportSettings  # noqa: PLC0415 - takes half a second
    from lab.missions.flight_import import prepare_import  # noqa: PLC0415 - takes a second

    given = corrections(units, columns)
    if kind is Kind.LOG:
        chosen = [axis.strip() for axis in axes.split(",")] if axes else []
        given = _add_log(files, name, title, preview, as_json, given, chosen, vehicle, calibration)
        _save_profile(save_profile, files, given)
        return
    if axes or vehicle or calibration:
        raise CommandError(
            "--axes, --vehicle and --calibration are of logs: they need --as log (--set vehicle=... for "
            "flights)"
        )
    settings = ImportSettings()
    settings.set_texts(assignments or [])
    with working(str(files[0])) as progress:
        progress("reading", 0.0)
        read = prepare_import(files, settings, given, _noise(card))
        refused = read.report.verdict == "implausible" and not implausible and not preview
        shown = _preview(read, files[0]) if preview else None
        added = None
        if not preview and not refused:
            progress("writing", 0.7)
            added = read.add(name or _free_name(files[0]), title, overwrite=force).name
    _print_report(read, added, shown, as_json)
    if not refused:
        _save_profile(save_profile, files, given)
    if refused:
        raise CommandError(f"{files[0]}: not added, since it is implausible; to add it anyway: --implausible")


def _add_log(
    files: Sequence[Path],
    name: str | None,
    title: str,
    preview: bool,
    as_json: bool,
    units: dict[str, str],
    axes: Sequence[str],
    named_vehicle: str,
    calibration: Path | None = None,
) -> dict[str, str]:
    """Add the IMU and GPS data of a file as a sensor log; return what was said of columns."""
    from lab.data.log.log_section import cut_section  # noqa: PLC0415 - beside what it goes with
    from lab.data.log.vehicle import VEHICLES, vehicle_of  # noqa: PLC0415 - beside what it goes with
    from lab.missions import add_log  # noqa: PLC0415 - beside what it goes with
    from lab.missions.flight_import import any_log  # noqa: PLC0415 - takes a second

    if preview:
        raise CommandError("--preview shows flights; a log is shown once it is navigated: ins-lab run NAME")
    if named_vehicle not in ("", *VEHICLES):
        raise CommandError(f"--vehicle {named_vehicle}: accepted are {', '.join(VEHICLES)}")
    with working(str(files[0])) as progress:
        progress("reading", 0.0)
        log, units = _answered(files, units, lambda said: any_log(files, said, axes, named_vehicle))
        if calibration is not None:
            from lab.missions.flight_import import calibrate_log  # noqa: PLC0415 - rarely needed

            log = calibrate_log(log, files, calibration, axes)
        progress("writing", 0.7)
        added = add_log(log, name or _free_name(files[0]), title=title or f"Log of {files[0].name}").name
    vehicle = vehicle_of(log.auxiliary.vehicle).name
    # With the gaps between which the log is navigated.
    repairs = (*cut_section(log).repairs, *_range_remarks(log))
    facts = {
        "added": added,
        "duration_s": log.duration,
        "vehicle": vehicle or None,
        "repairs": list(repairs),
    }
    if as_json:
        print_json(facts)
        return units
    print(f"IMU: {len(log.dtheta)} samples in {log.duration:.1f} s. GPS: {len(log.gnss.time)} fixes.")
    for repair in repairs:
        print(f"- {repair}")
    if not vehicle:
        print(f"- The file does not name its vehicle; ins-lab run --vehicle takes {', '.join(VEHICLES)}.")
    print(f"Added: {added}. Navigate it: ins-lab run {_quote_name(added)}")
    return units


def _answered(
    files: Sequence[Path], units: dict[str, str], read: Callable[[dict[str, str]], SensorLog]
) -> tuple[SensorLog, dict[str, str]]:
    """Return what is read, and the units with the answer to a question about them.

    Without a terminal, the command that answers is printed instead.
    """
    from lab.base.files.mission_error import QuestionError  # noqa: PLC0415 - beside what it goes with

    try:
        return read(units), units
    except QuestionError as question:
        words = list(question.choices)
        if not sys.stdin.isatty():
            names = shlex.join(map(str, files))
            commands = [
                f"  ins-lab import {names} --as log "
                + shlex.join([part for at, unit in said.items() for part in ("--unit", f"{at}={unit}")])
                for said in question.choices.values()
            ]
            raise CommandError("\n".join((f"{question}. Either of:", *commands))) from question
        print(question, file=sys.stderr)
        answer = typer.prompt(" or ".join(words), value_proc=partial(_ask_one, words), err=True)
        said = {**units, **question.choices[answer]}
        return read(said), said


def _ask_one(words: Sequence[str], answer: str) -> str:
    """Return an answer that is one of some words; it is asked for again otherwise."""
    if answer not in words:
        raise typer.BadParameter(f"{answer!r} is not one of {', '.join(words)}.")
    return answer


def _save_profile(name: str | None, files: Sequence[Path], units: dict[str, str]) -> None:
    """Keep what is said of columns as a profile."""
    if name is None:
        return
    from lab.data.sheets.profile_check import save_profile  # noqa: PLC0415 - beside what it goes with

    print(f"Profile: {save_profile(name, files, units)}", file=sys.stderr)


def _range_remarks(log: SensorLog) -> list[str]:
    import numpy as np  # noqa: PLC0415 - beside what it goes with

    from lab.data.checks.full_scale import range_remarks  # noqa: PLC0415 - beside what it goes with

    return range_remarks(np.concatenate(log.rates, axis=1))


def _quote_name(name: str) -> str:
    """Return the name of a mission as a shell takes it."""
    return name if re.fullmatch(r"[\w.+-]+", name) else f'"{name}"'


def _free_name(file: Path) -> str:
    from lab.data.streams.raw_recording import SUFFIX  # noqa: PLC0415 - rarely needed
    from lab.missions.library import free_name  # noqa: PLC0415 - rarely needed
    from lab.missions.mission_name import without_archive  # noqa: PLC0415 - beside what it goes with

    return free_name(without_archive(file.name.removesuffix(SUFFIX)))


def _noise(card: str | None) -> SensorNoise:
    """Return the white noise of a card, or of the default sensors."""
    from lab.sensors.cards import CLASSIC  # noqa: PLC0415 - takes half a second
    from lab.sensors.cards import card as find_card  # noqa: PLC0415 - takes half a second
    from lab.sensors.suite import SensorSuite, white_noise  # noqa: PLC0415 - takes half a second

    chosen = find_card(card or CLASSIC)
    return white_noise(SensorSuite().update(chosen.settings()), chosen.name)


def _preview(read: FlightImport, file: Path) -> Path:
    """Write the preview of a flight into the current folder, and return its path."""
    from lab.views.import_preview import save_preview  # noqa: PLC0415 - Bokeh takes a second

    out = Path(f"{file.name}.preview.html")
    with writing(out):
        save_preview(read, out)
    return out


def _print_report(read: FlightImport, added: str | None, shown: Path | None, as_json: bool) -> None:
    """Print the report and the outcome."""
    has_log = read.log is not None
    if as_json:
        facts = _facts(read.report)
        shown_at = None if shown is None else str(shown)
        print_json({**facts, "added": added, "preview": shown_at, "has_log": has_log})
        return
    print(read.report)
    if has_log:
        print("The file also holds IMU and GPS data of the flight: --as log adds these as a log.")
    if shown is not None:
        print(f"Preview: {shown}")
    if added is not None:
        print(f"Added: {added}. Navigate it: ins-lab run {_quote_name(added)}")


def _facts(report: ImportReport) -> dict[str, Any]:
    return {
        "verdict": report.verdict,
        "reasons": list(report.reasons),
        "specific_force_noise_m_s2": report.specific_force_noise,
        "body_rate_noise_rad_s": report.body_rate_noise,
        "rows": [{"group": row.group, "name": row.name, "value": row.value} for row in report.rows],
    }
