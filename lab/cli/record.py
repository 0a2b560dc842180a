"""``ins-lab record``: a mission recorded from a running X-Plane."""

from __future__ import annotations

import sys
import threading
import time
from typing import TYPE_CHECKING, Annotated

import typer

from lab.cli.app import CommandError, argument, option, working
from lab.cli.interrupt import interrupted
from lab.cli.options import Force, MissionFolder
from lab.cli.terminal import ProgressLine
from lab.missions import own_folder
from lab.missions.mission_name import accepted_name

if TYPE_CHECKING:
    from lab.data.rebuild.raw_flight import RawFlight
    from lab.data.streams.xplane_live import XPlaneRecorder

EXAMPLES = """\b
Examples:
  ins-lab record circuit
  ins-lab record approach --host 192.168.1.20 --seconds 300
X-Plane must run with a flight loaded, and accept incoming connections in its Settings, Network."""

PATIENCE = 30.0
"""Time without data from X-Plane after which the recording ends [s]."""
_PERIOD = 0.2
"""Time between two checks of the recording [s]."""


def record(
    name: Annotated[str, argument("NAME", "Name of the mission.")],
    host: Annotated[
        str, typer.Option("--host", metavar="HOST", help="Computer that X-Plane runs on.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", metavar="PORT", help="UDP port of X-Plane.")] = 49000,
    rate: Annotated[
        float, typer.Option("--rate", metavar="HZ", help="Samples per second, at most one per frame.")
    ] = 50.0,
    seconds: Annotated[float | None, option("--seconds", "S", "How long to record.", "until Ctrl-C")] = None,
    title: Annotated[str, option("--title", "TEXT", "Title of the mission.")] = "",
    out: MissionFolder = None,
    force: Force = False,
) -> None:
    """Record a mission from a running X-Plane.

    Ctrl-C ends the recording and keeps it. The same happens when X-Plane stops sending.
    """
    from lab.data.streams.xplane_live import XPlaneRecorder  # noqa: PLC0415
    from lab.missions.flight_import import prepare_flight  # noqa: PLC0415 - loads what help does not need

    # Checked first: after an hour's flight it is too late to find that the name is in use.
    name = accepted_name(name)
    taken = (out or own_folder()) / f"{name}.toml"
    if taken.exists() and not force:
        raise CommandError(f"{taken} exists; --force replaces it")
    if seconds is not None and not seconds > 0:
        raise CommandError(f"--seconds {seconds:g}: accepted are more than 0")
    where = f"X-Plane at {host}:{port}"
    with (
        working(where) as progress,
        interrupted() as pressed,
        XPlaneRecorder(host, port, rate) as recorder,
    ):
        raw = _record_flight(recorder, pressed, seconds, progress)
        flight = prepare_flight(raw)
        mission = flight.add(name, title or f"Flight in {where}", folder=out, overwrite=force)
    for remark in (*raw.remarks, *(finding.sentence for finding in flight.report.findings)):
        print(f"ins-lab: {remark}", file=sys.stderr)
    print(f"{mission.recording_path}: {len(raw.time)} samples, {flight.recording.duration:.1f} s recorded")


def _record_flight(
    recorder: XPlaneRecorder, pressed: threading.Event, seconds: float | None, progress: ProgressLine
) -> RawFlight:
    """Return the data from X-Plane until the time is over, Ctrl-C is pressed, or the data stop."""
    recorder.start()
    heard = time.monotonic()
    told = ""
    while not pressed.wait(_PERIOD) and recorder.running:
        if seconds is not None and recorder.seconds >= seconds:
            break
        step = "recording, Ctrl-C ends it" if recorder.samples else "waiting for the first sample"
        progress(step, min(recorder.seconds / seconds, 0.99) if seconds else 0.0)
        problem = recorder.problem
        if not problem:
            heard = time.monotonic()
        elif time.monotonic() - heard > PATIENCE:
            break
        elif not told:
            print(f"ins-lab: {problem}", file=sys.stderr)
        told = problem
    return recorder.stop()
