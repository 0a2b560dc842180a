"""``ins-lab live``: streams of sensors: found, watched, recorded, navigated with, and simulated."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.base.parameters.counted import count_noun
from lab.base.parameters.setting_error import SettingError
from lab.base.plain_data import to_plain_data
from lab.cli import options
from lab.cli.app import CommandError, argument, group, option, print_json, working
from lab.cli.interrupt import interrupted
from lab.cli.live_solution import (
    SOLUTION_HEAD,
    Destinations,
    publishing,
    said_of,
    solution_line,
    solution_row,
)
from lab.cli.live_status import check_came, count_arrivals, print_conclusion, source_line, source_row
from lab.cli.raw_file import RawFile
from lab.cli.terminal import table
from lab.missions.mission_name import accepted_name

if TYPE_CHECKING:
    from lab.data.streams.source import Source
    from lab.data.streams.source_status import Status
    from lab.live.simulated.simulated_device import SimulatedDevice

EXAMPLES = """\b
Examples:
  ins-lab live list
  ins-lab live watch simulated:montreal?device=vectornav
  ins-lab live watch serial:/dev/ttyUSB0?baud=115200
  ins-lab live navigate serial:/dev/ttyUSB0 --card ADIS16470
  ins-lab live navigate serial:/dev/ttyUSB0 --to udp:127.0.0.1:9870 --hz 50
  ins-lab live navigate simulated:montreal --algorithm my_filter.py:Complementary
  ins-lab live navigate "xplane:127.0.0.1:49000?card=ADIS16470" --card ADIS16470
  ins-lab live record tcp:192.168.1.20:5555 drive --seconds 600
  ins-lab live simulate montreal --device vectornav --to tcp:5555
A source is serial:PORT, udp:PORT, tcp:COMPUTER:PORT, replay:FILE, simulated:MISSION or xplane:COMPUTER.
Options follow a question mark, with & between: baud=115200, protocol=vectornav, axes=y,x,-z, speed=10."""

live = group("live")

PERIOD = 1.0
"""Time between two lines of `watch` [s]."""
_ANY = "montreal"
"""A mission of the settings, which a stream does not use."""
TEXT = "text"
"""Protocol of text lines, to which `--unit` and `--column` belong."""
_WAKE = 0.1
"""Longest time until Ctrl-C is heeded [s]."""

SourceAddress = Annotated[str, argument("SOURCE", "The source, such as tcp:127.0.0.1:5555.")]
CalibrationFile = Annotated[
    Path | None,
    option("--calibration", "FILE.toml", "Constant errors of the device to remove, from ins-lab calibrate."),
]
Seconds = Annotated[float | None, option("--seconds", "S", "How long.", "until Ctrl-C, or its end")]


@live.command("list")
def list_sources(as_json: options.AsJson = False) -> None:
    """List the serial ports of this computer, the protocols, and the forms of sources."""
    from lab.data.protocols.catalogue import DECODERS, ENCODERS  # noqa: PLC0415 - help does not need it
    from lab.data.streams.address import FORMS  # noqa: PLC0415 - help does not need it
    from lab.data.streams.serial_port import serial_ports  # noqa: PLC0415 - help does not need it
    from lab.data.streams.transport import TransportError  # noqa: PLC0415 - help does not need it

    try:
        ports, why = serial_ports(), ""
    except TransportError as error:
        ports, why = [], str(error)
    if as_json:
        print_json(
            {
                "ports": [port._asdict() for port in ports],
                "problem": why,
                "protocols": list(DECODERS),
                "simulated devices": list(ENCODERS),
                "sources": list(FORMS),
            }
        )
        return
    if why:
        print(f"ins-lab: {why}", file=sys.stderr)
    rows = [(port.address, port.description or "-") for port in ports]
    print(table(("SERIAL PORT", "DEVICE"), rows) if rows else "No serial ports.")
    print(f"\nProtocols: {', '.join(DECODERS)}.")
    print(f"Sources: {', '.join(FORMS)}.")


@live.command("watch", epilog=EXAMPLES)
def watch(
    source: SourceAddress,
    seconds: Seconds = None,
    units: options.StreamUnits = None,
    columns: options.StreamColumns = None,
    rate: options.SampleRate = None,
    calibration: CalibrationFile = None,
    as_json: options.AsJson = False,
) -> None:
    """Show what a source sends: a line a second; with --json one object a line."""
    _check_seconds(seconds)
    said = options.stream_options(units, columns, rate)
    with _open_source(source, said, _prepare_calibration(calibration)) as (opened, go_on):
        if not as_json:
            print(
                "TIME [s]  RATE [Hz]  FIXES  RATE x, y, z [deg/s]         FORCE x, y, z [m/s^2]        STATE"
            )
        begin = time.monotonic()
        question = ""
        while go_on(seconds):
            status = opened.status
            question = _print_question(status, question)
            print(
                json.dumps(to_plain_data(source_row(opened, status)), allow_nan=False)
                if as_json
                else source_line(opened, status, time.monotonic() - begin),
                flush=True,
            )
        status = opened.status
    _print_question(status, question)
    check_came(source, status)
    print(f"ins-lab: {status.sentence}", file=sys.stderr)
    print_conclusion(status)


@live.command("record", epilog=EXAMPLES)
def record(
    source: SourceAddress,
    name: Annotated[str, argument("NAME", "Name of the mission.")],
    seconds: Seconds = None,
    units: options.StreamUnits = None,
    columns: options.StreamColumns = None,
    rate: options.SampleRate = None,
    title: Annotated[str, typer.Option("--title", metavar="TEXT", show_default=False)] = "",
    lever_arm: Annotated[
        str,
        typer.Option(
            "--lever-arm", metavar="X,Y,Z", help="From the IMU to the antenna: forward, right, down [m]."
        ),
    ] = "0,0,0",
    out: options.MissionFolder = None,
) -> None:
    """Record a source; with an IMU and fixes it becomes a mission.

    The bytes are kept in NAME.inslab beside the mission; replay:NAME.inslab plays them again.
    """
    from lab.missions import own_folder  # noqa: PLC0415 - help does not need it

    name, arm = accepted_name(name), _three(lever_arm)
    _check_seconds(seconds)
    folder = out or own_folder()
    if (folder / name).exists():
        raise CommandError(f"{folder / name} exists; accepted is a new name")
    raw = RawFile(folder, name)
    path = raw.path
    with _open_source(source, options.stream_options(units, columns, rate), raw.begin) as (opened, go_on):
        while go_on(seconds):
            warning = opened.status.warning
            if warning:
                print(f"ins-lab: {warning}", file=sys.stderr)
            if warning and not opened.recording:
                break
        running = opened.stop_recording()
        status = opened.status
    _print_question(status)
    if running and status.warning:
        print(f"ins-lab: {status.warning}", file=sys.stderr)
    if not status.statistics.bytes:
        raw.discard()  # the name is free for another attempt
    check_came(source, status)
    print_conclusion(status)
    print(f"{path}: {count_noun(status.recorded, 'byte')}, {count_arrivals(status)}")
    if not status.samples or not status.fixes:
        lacking = "samples of an IMU" if not status.samples else "fixes"
        print(f"No mission: the source sent no {lacking}, and a sensor log needs both.")
        return
    log, mission = raw.as_mission(name, arm, title or f"Recorded from {source}", out)
    for remark in log.repairs:
        print(f"ins-lab: {remark}", file=sys.stderr)
    print(f"{mission.path}: {log.duration:.1f} s, navigate it with: ins-lab run {mission.name}")


@live.command("navigate", epilog=EXAMPLES)
def navigate(
    source: SourceAddress,
    seconds: Seconds = None,
    units: options.StreamUnits = None,
    columns: options.StreamColumns = None,
    rate: options.SampleRate = None,
    config: options.Config = None,
    card: options.Card = None,
    assignments: options.Assignments = None,
    calibration: CalibrationFile = None,
    to: Destinations = None,
    hz: Annotated[
        float | None, option("--hz", "HZ", "Rows that --to sends per second, 0.1 to 200.", "10")
    ] = None,
    algorithms: Annotated[
        list[str] | None,
        option(
            "--algorithm",
            "FILE.py:Name",
            "An attitude filter of yours, with a method step, that follows the source beside the "
            "navigator; the file is executed; may be repeated.",
        ),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Navigate with a source as it comes: a line a second; with --json one object a line.

    The settings are the assumptions of the filter: the card of the sensor, and for example
    --set navigator.initial_heading=90.
    """
    from lab.cli.beside_lines import BesideLines  # noqa: PLC0415 - help does not need it
    from lab.live.live_navigator import STEP  # noqa: PLC0415 - help does not need it
    from lab.live.station import Station  # noqa: PLC0415 - help does not need it

    _check_seconds(seconds)
    chosen = options.experiment(_ANY, config, card, assignments, None)
    of_stream = options.stream_options(units, columns, rate)
    with (
        _open_source(source, of_stream, _prepare_calibration(calibration)) as (opened, go_on),
        publishing(to or (), hz) as publisher,
    ):
        try:
            step = min(STEP, publisher.period)
            tell = publisher.offer if to else None
            station = Station(opened, chosen.sensors, chosen.navigator, source, step, tell)
        except SettingError as error:
            raise CommandError(str(error)) from error
        try:
            beside = BesideLines(station, algorithms or ())
            if not as_json:
                print(SOLUTION_HEAD)
            begin = time.monotonic()
            more, question = True, ""
            said: set[str] = set()
            while more:
                more = go_on(seconds)
                question = _print_question(opened.status, question)
                said = said_of(publisher, said)
                if not more:
                    station.wait()
                known = station.state
                beside.advance(finish=not more)
                if as_json:
                    row = solution_row(known) | to_plain_data(beside.facts())
                    print(json.dumps(row, allow_nan=False), flush=True)
                else:
                    line = solution_line(known, time.monotonic() - begin)
                    print(line, *beside.lines(), sep="\n", flush=True)
        finally:
            station.close()
        check_came(source, opened.status)
        print_conclusion(opened.status)
    known = station.state
    for sentence in (f"{known.phase.capitalize()}: {known.reason}", *known.remarks, station.failure):
        if sentence:
            print(f"ins-lab: {sentence}", file=sys.stderr)
    out = sys.stderr if as_json else sys.stdout  # objects stay alone, one a line
    print("\n".join(beside.conclusion()), end="", file=out)
    if station.verdict:
        print(f"Verdict on the innovations: {station.verdict}", file=out)


@live.command("simulate", epilog=EXAMPLES)
def simulate(
    mission: Annotated[str, argument("MISSION", "A mission; or rest, for a device on a table.")],
    device: Annotated[str, typer.Option("--device", metavar="NAME", help="Whose protocol.")] = "vectornav",
    to: Annotated[
        str, typer.Option("--to", metavar="LINK", help="pty, tcp:PORT or udp:ADDRESS:PORT.")
    ] = "tcp:5555",
    card: Annotated[str, option("--card", "NAME", "Sensors of a card.", "default sensors")] = "",
    rate: Annotated[
        float, typer.Option("--rate", metavar="HZ", help="Samples of the IMU per second.")
    ] = 100.0,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Seed of all random draws.")] = 1,
    rest: Annotated[float, typer.Option("--rest", metavar="S", help="Rest before the flight.")] = 0.0,
    corruption: Annotated[
        float, typer.Option("--corruption", metavar="PART", help="Part of the bytes that are damaged.")
    ] = 0.0,
    jitter: Annotated[float, typer.Option("--jitter", metavar="MS", help="Mean delay of the sending.")] = 0.0,
    drift: Annotated[float, typer.Option("--drift", metavar="PPM", help="Error of its clock.")] = 0.0,
    axes: Annotated[str, typer.Option("--axes", metavar="AXES", help="How it is mounted: y,x,-z.")] = "x,y,z",
    assignments: options.Assignments = None,
) -> None:
    """Send a mission as a device would, in real time, until it ends or Ctrl-C is pressed.

    A device on a table stands until Ctrl-C, unless --rest says how long; what it measures is repeated after
    ten minutes.

    The settings are those of the sensors: --set sensors.heading.fitted=true sends headings too.
    """
    from lab.data.streams.axis_map import AxisMap  # noqa: PLC0415 - help does not need it
    from lab.live.simulated.simulated_device import (  # noqa: PLC0415 - help does not need it
        Misbehaviour,
        SimulatedDevice,
        make_encoder,
        unsent_readings,
    )
    from lab.live.simulated.simulated_flight import REST, USUAL_REST, SimulatedFlight  # noqa: PLC0415
    from lab.live.simulated.simulated_link import make_link  # noqa: PLC0415 - help does not need it

    _check(rate, 1, 2000, "--rate", "Hz")
    _check(corruption, 0, 0.1, "--corruption")
    _check(jitter, 0, 1000, "--jitter", "ms")
    _check(drift, -5000, 5000, "--drift", "ppm")
    _check(rest, 0, 3600, "--rest", "s")
    with working(mission):
        link, encoder = make_link(to), make_encoder(device)
        stands = mission == REST and not rest
        flight = SimulatedFlight.of(
            mission, rate, sensor=card, seed=seed, rest=USUAL_REST if stands else rest,
            axes=AxisMap.of(axes), assignments=assignments or (),
        )  # fmt: skip
        wrong = Misbehaviour(corruption, 1e-3 * jitter, 1e-6 * drift)
        sender = SimulatedDevice(flight, encoder, link, wrong, endless=stands)
    if unsent := unsent_readings(device, flight.reading):
        print(f"ins-lab: --device {device}: {unsent}", file=sys.stderr)
    with interrupted() as pressed, _start_sender(sender, to):
        print(
            f"Sending {'until Ctrl-C' if stands else count_noun(len(flight.imu), 'sample')}; open it with: "
            f"ins-lab live watch {sender.address}",
            flush=True,
        )
        while not sender.finished and not pressed.wait(_WAKE):
            pass
    lost = f"; nobody read {count_noun(sender.refused, 'byte')}" if sender.refused else ""
    print(f"{count_noun(sender.sent, 'sample')} sent, at most {sender.latest:.3f} s late{lost}")


@contextmanager
def _start_sender(sender: SimulatedDevice, to: str) -> Iterator[None]:
    """Let a simulated device send; refuse a line that cannot be made."""
    from lab.data.streams.transport import describe_cause  # noqa: PLC0415 - help does not need it

    try:
        sender.start()
    except OSError as error:
        raise CommandError(f"--to {to}: {describe_cause(error)}") from error
    try:
        yield
    finally:
        sender.close()


def _prepare_calibration(calibration: Path | None) -> Callable[[Source], None]:
    """Return what gives a source the calibration of a file, if there is one."""
    if calibration is None:
        return lambda source: None
    from lab.data.log.calibration import read_calibration  # noqa: PLC0415 - rarely needed

    known = read_calibration(calibration)
    return lambda source: setattr(source, "calibration", known)


@contextmanager
def _open_source(
    address: str,
    said: Mapping[str, str],
    prepare: Callable[[Source], None] = lambda source: None,
) -> Iterator[tuple[Source, Callable[[float | None], bool]]]:
    """Yield an open source, and a function that waits a moment and returns whether to go on."""
    from lab.data.protocols.column_map import ColumnMapError  # noqa: PLC0415 - help does not need it
    from lab.data.protocols.decoder import DecoderError  # noqa: PLC0415 - help does not need it
    from lab.data.streams.raw_recording import RecordingError  # noqa: PLC0415 - help does not need it
    from lab.data.streams.transport import TransportError  # noqa: PLC0415 - help does not need it
    from lab.live import open as open_source  # noqa: PLC0415 - help does not need it

    with working(address):
        try:
            source = open_source(address, **said)
            prepare(source)
        except (RecordingError, TransportError, DecoderError, ColumnMapError) as error:
            raise CommandError(str(error)) from error
    with interrupted() as pressed, source:
        begin, done = math.nan, False

        def go_on(seconds: float | None) -> bool:
            """Wait until the next line is due; return whether there is one more."""
            nonlocal begin, done
            begin = time.monotonic() if math.isnan(begin) else begin
            due = time.monotonic() + PERIOD
            while time.monotonic() < due and not done:
                over = seconds is not None and time.monotonic() - begin >= seconds
                done = over or pressed.wait(_WAKE) or source.ended
            return not done

        yield source, go_on
        protocol = source.status.protocol
        if "unit" in said and protocol and protocol != TEXT:
            print(
                f"ins-lab: --unit had no effect: units are of text lines, and the source sends {protocol}",
                file=sys.stderr,
            )


def _print_question(status: Status, before: str = "") -> str:
    """Print a question about the source once, on standard error; return it."""
    if status.question and status.question != before:
        print(f"ins-lab: {status.question}", file=sys.stderr, flush=True)
    return status.question


def _check_seconds(seconds: float | None) -> None:
    if seconds is not None and not seconds > 0:
        raise CommandError(f"--seconds {seconds:g}: accepted are more than 0")


def _check(value: float, least: float, most: float, option: str, unit: str = "") -> None:
    if not least <= value <= most:
        raise CommandError(f"{option} {value:g}: accepted are {least:g} to {most:g} {unit}".rstrip())


def _three(text: str) -> tuple[float, float, float]:
    from lab.data.log.sensor_log import MAX_LEVER_ARM  # noqa: PLC0415 - help does not need it

    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise CommandError(f"--lever-arm {text}: accepted are three numbers, such as 0.5,0,-1.2") from error
    if not all(abs(one) <= MAX_LEVER_ARM for one in (x, y, z)):
        raise CommandError(f"--lever-arm {text}: accepted are numbers up to {MAX_LEVER_ARM:g} m")
    return x, y, z
