"""``ins-lab numbers``: which noise of an IMU goes into a filter, from a log at rest and from a drive."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from lab.cli.app import CommandError, option, print_json, working
from lab.cli.options import AsJson, Assignments, Config, experiment
from lab.cli.terminal import format_list, paragraphs, table

if TYPE_CHECKING:
    from lab.experiment.number_table import ImuNumbers

EXAMPLES = """\b
Examples:
  ins-lab numbers --static still.csv --moving drive.ulg
  ins-lab numbers --moving my_drive --for px4
  ins-lab numbers --static still.csv --for kalibr
The drive is a file with an IMU and a GPS receiver, or a sensor log among the missions. Without --static, the
longest rest of the drive is taken. Intervals are 95 % intervals."""


def numbers(
    static: Annotated[Path | None, option("--static", "FILE", "Log of the IMU at rest.")] = None,
    moving: Annotated[str | None, option("--moving", "MISSION|FILE", "Sensor log of a drive.")] = None,
    program: Annotated[
        str | None,
        option(
            "--for",
            "PROGRAM",
            "Lines for the configuration of kalibr, px4, ardupilot, robot_localization, kf-gins or matlab.",
        ),
    ] = None,
    config: Config = None,
    assignments: Assignments = None,
    as_json: AsJson = False,
) -> None:
    """Show the noise of an IMU at rest and in motion, why they differ, and what a filter should assume."""
    from lab.experiment import filter_programs, imu_numbers  # noqa: PLC0415 - help does not need them
    from lab.experiment.log_file import mission_name, open_mission  # noqa: PLC0415 - beside them

    if static is None and moving is None:
        raise CommandError("numbers needs --static FILE, --moving MISSION|FILE, or both")
    if program is not None and program not in filter_programs.PROGRAMS:
        raise CommandError(f"--for {program}: accepted are {', '.join(filter_programs.PROGRAMS)}")
    with working(moving or str(static)) as progress, contextlib.ExitStack() as stack:
        drive = None if moving is None else stack.enter_context(open_mission(moving))
        chosen = None if drive is None else experiment(drive, config, None, assignments, None)
        found = imu_numbers.numbers(static, chosen, progress)
    lines = "" if program is None else filter_programs.lines(found, program)
    if as_json:
        from lab.run.provenance import describe_origin  # noqa: PLC0415 - help does not need it

        origin = describe_origin(chosen)
        if chosen is not None:
            name = mission_name(chosen.mission)
            origin |= {"mission": name, "settings": {**origin["settings"], "mission": name}}
        print_json({**origin, **found.to_dict(), "program": program, "lines": lines or None})
    elif program is not None:
        print(lines)
    else:
        print(_text(found))


def _text(found: ImuNumbers) -> str:
    from lab.experiment.number_table import HEADS, UNKNOWN  # noqa: PLC0415 - help does not need it

    causes = [f"{row.triad}, {row.term}: {row.basis}. Cause of the factor: {row.cause}" for row in found.rows]
    return paragraphs(
        f"At rest: {found.static or UNKNOWN}. In motion: {found.moving or UNKNOWN}.",
        table(HEADS, found.cells, right={5, 7}),
        found.convention,
        format_list(causes),
        format_list(found.remarks),
    )
