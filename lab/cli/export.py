"""``ins-lab export``: the path of a mission, for maps, tables and programs that evaluate trajectories."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from lab.cli.app import CommandError, option, writing
from lab.cli.options import Force, Mission, check_out
from lab.missions import mission as find_mission

if TYPE_CHECKING:
    from lab.experiment.result import Result
    from lab.missions import Mission as Found

ENDINGS = (".kml", ".gpx", ".csv", ".csv.gz", ".solution.csv", ".tum", ".pos", ".sbet", ".out", ".parquet")

EXAMPLES = """\b
Examples:
  ins-lab export montreal --to montreal.kml
  ins-lab export my_drive --to my_drive.gpx
  ins-lab run montreal --export run.kml
  ins-lab run montreal --export run.tum
run.kml holds the true path, the estimated path and the GPS fixes of a run, run.tum the estimate.
.tum is for evo, .pos for RTKLIB, .sbet and .out are SBET. .solution.csv and .parquet hold position, velocity,
attitude and, of a run, their σ."""


def export(
    mission: Mission,
    to: Annotated[Path, option("--to", "FILE", f"File to write, ending in {', '.join(ENDINGS)}.")],
    force: Force = False,
) -> None:
    """Write the path of a mission: KML, GPX, a flight csv, or a trajectory for other programs."""
    check_export(to, force, "--to")
    write(find_mission(mission), to, force, "--to")
    print(to)


def check_export(path: Path | None, force: bool, option: str) -> None:
    """Check before the work that a file can be written.

    Raises
    ------
    CommandError
        If the ending is wrong, the file exists, or its folder is not writable.
    """
    if path is not None:
        ending = next((one for one in ENDINGS if path.name.lower().endswith(one)), "")
        if not ending:
            raise CommandError(f"{option} {path}: accepted are names ending in {', '.join(ENDINGS)}")
        if ending == ".parquet" and find_spec("pyarrow") is None:
            raise CommandError(f"{option} {path}: parquet needs pyarrow: pip install 'ins-lab[parquet]'")
        check_out(path, force, path.suffix.lower(), "a file", option)


def write(source: Found | Result, path: Path, force: bool, option: str) -> None:
    """Write a mission or a run.

    Raises
    ------
    CommandError
        If the file cannot be written.
    """
    from lab.views.export import export_track  # noqa: PLC0415 - takes a second

    with writing(path, option):
        export_track(source, path, overwrite=force)
