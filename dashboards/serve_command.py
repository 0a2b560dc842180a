"""Serve command: ``ins-lab serve``, the dashboard on a port that is free."""

from __future__ import annotations

import errno
import importlib.util
import os
import socket
import sys
import webbrowser
from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from lab.cli.app import CommandError, option
from lab.cli.options import AlgorithmFiles, Scheduler, algorithms, cluster_of

EXAMPLES = """\b
Examples:
  ins-lab serve --port 8000
  ins-lab serve --algorithm my_filter.py:MyFilter
  ins-lab serve --phone --live-algorithm my_filter.py:Complementary
  ins-lab serve --lessons my_lessons
  ins-lab serve --homework my_keys
  ins-lab serve --address 0.0.0.0 --teacher
  ins-lab serve --phone
  ins-lab serve --allow-device "serial:/dev/ttyUSB0?baud=115200"
  ins-lab serve --address 0.0.0.0 --password-file secret.txt
  ins-lab serve --address 0.0.0.0 --processes 4
  ins-lab serve --origin lab.example.org --proxy 127.0.0.1
  ins-lab serve --scheduler tcp://192.168.1.5:8786
Only this computer reaches the page, unless you name another address. Visitors may
then run missions and change settings; --visitors edit lets them change missions too.
The page Compare shows your algorithm beside the error models."""

MAX_PASSWORD = 1024
"""Longest password [bytes]."""
LEAST_PASSWORD = 8
"""Shortest password [characters]: at eight guesses a second, eight random letters last 800 years."""

MOST_PROCESSES = 64
"""Most processes of a server: each takes 0.3 GB before the first page opens."""

_NO_ADDRESS = "--address {}: is not an address of this computer, such as 127.0.0.1 or localhost"


class Visitors(StrEnum):
    """What visitors may do."""

    RUN = "run"
    EDIT = "edit"


def serve(
    port: Annotated[
        int, typer.Option("--port", min=1, max=65535, metavar="PORT", help="Port of the page.")
    ] = 5006,
    address: Annotated[
        str, typer.Option("--address", metavar="ADDRESS", help="Address to listen on; 0.0.0.0 is all.")
    ] = "127.0.0.1",
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open the page.")] = False,
    own: AlgorithmFiles = None,
    live: Annotated[
        list[str] | None,
        option(
            "--live-algorithm",
            "FILE.py:Name",
            "Your own attitude filter, with a method step, beside the streams of the page Live; may be "
            "repeated. The file is executed.",
        ),
    ] = None,
    scheduler: Scheduler = None,
    origin: Annotated[
        list[str] | None,
        option(
            "--origin",
            "HOST[:PORT]",
            "A further host name of the page, such as that of a proxy; may be repeated.",
        ),
    ] = None,
    proxy: Annotated[
        list[str] | None,
        option(
            "--proxy",
            "ADDRESS",
            "Address or network of a proxy whose X-Forwarded headers are believed; may be repeated.",
        ),
    ] = None,
    processes: Annotated[
        int,
        typer.Option(
            "--processes",
            min=1,
            max=MOST_PROCESSES,
            metavar="N",
            help="Processes that share the visitors; classes and streams live in the first.",
        ),
    ] = 1,
    visitors: Annotated[
        Visitors | None,
        typer.Option(
            "--visitors",
            help="What visitors may do: run, or edit missions too. Default: edit on loopback, else run.",
            show_default=False,
        ),
    ] = None,
    password_file: Annotated[
        Path | None, option("--password-file", "FILE", "File whose one line is the password for visitors.")
    ] = None,
    devices: Annotated[
        list[str] | None,
        option(
            "--allow-device",
            "SOURCE",
            "A source that the page Live may open, such as serial:/dev/ttyUSB0, or serial:* for all "
            "serial ports; may be repeated.",
        ),
    ] = None,
    phone: Annotated[
        bool,
        typer.Option(
            "--phone", help="Take phones as sensors: they reach a page of their own in your network."
        ),
    ] = False,
    phone_port: Annotated[
        int,
        typer.Option("--phone-port", min=1, max=65534, metavar="PORT", help="Port of the page for phones."),
    ] = 5008,
    lessons: Annotated[
        Path | None,
        option(
            "--lessons",
            "FOLDER",
            "A folder with lessons of your own; its files are read again when they change.",
        ),
    ] = None,
    homework: Annotated[
        Path | None,
        option(
            "--homework",
            "FOLDER",
            "A folder with keys of homework: this server runs it, so that nothing hidden leaves it.",
        ),
    ] = None,
    teacher: Annotated[
        bool,
        typer.Option("--teacher", help="Print a link for teachers: their page leads a class of students."),
    ] = False,
    warm: Annotated[
        bool, typer.Option("--warm/--no-warm", help="Compile the filter ahead, in the background.")
    ] = True,
) -> None:
    """Serve the dashboard, and open it in a browser if there is a screen."""
    first = "" if _has_run() else " for the first time, which takes ten seconds or more"
    print(f"ins-lab: starting{first} …", file=sys.stderr, flush=True)
    _check_folder("--lessons", lessons, "lessons as .toml files")
    _check_folder("--homework", homework, "the keys of homework as .key files")
    _check_processes(processes)
    _check_proxies(proxy or ())
    algorithms(own)  # a failure to load is reported now, not to visitors
    if live:
        _take_live_algorithms(live)
    password = None if password_file is None else read_password(password_file)
    if origin:
        _check_origins(address, port, origin)
    _allow_devices(devices or ())  # also none: those of the environment are for `panel serve`
    show = not no_browser and _has_screen()
    what: dict[str, Any] = {
        "port": port,
        "address": address,
        "algorithms": own or (),
        "origins": origin or (),
        "proxies": proxy or (),
        "visitors": None if visitors is None else visitors.value,
        "password": password,
        "lessons": lessons,
        "homework": homework,
        "teacher": teacher,
        "warm": warm,
    }
    if processes > 1:
        _check_port(address, port)
        phones = _phones(address, phone_port) if phone else None
        _serve_processes(what, processes, show, devices or (), phones, scheduler)
        return
    with cluster_of(scheduler) as client:
        # Last, so that another server on the port does not hide what is wrong with the other options.
        _check_port(address, port)
        if phone:
            from dashboards.phones import take_phones  # noqa: PLC0415 - takes a second

            take_phones(*_phones(address, phone_port))
        from dashboards import server  # noqa: PLC0415 - takes a second

        server.serve(show=show, client=client, **what)


def _serve_processes(
    what: dict[str, Any],
    processes: int,
    show: bool,
    devices: Sequence[str],
    phones: tuple[str, int] | None,
    scheduler: str | None,
) -> None:
    """Serve in several processes; the first compiles the filter ahead for all."""
    from dashboards.front import serve_processes  # noqa: PLC0415 - only needed here
    from dashboards.server import Laboratory, begin, greeting_of  # noqa: PLC0415
    from dashboards.worker import Part  # noqa: PLC0415

    first = Laboratory(**what)
    others = replace(first, warm=False)
    start = begin(first)
    parts = [
        Part(number, others if number else first, start, devices, phones, scheduler)
        for number in range(processes)
    ]

    def opened() -> None:
        if show:
            webbrowser.open(f"http://localhost:{first.port}/")

    serve_processes(parts, greeting_of(first, start.token), opened)


def _check_processes(processes: int) -> None:
    if processes > 1 and not hasattr(socket, "send_fds"):
        raise CommandError(f"--processes {processes}: this system cannot share a port; accepted is 1")


def _check_proxies(proxies: Sequence[str]) -> None:
    from dashboards.forwarded import networks  # noqa: PLC0415 - takes a moment

    try:
        networks(proxies)
    except ValueError as error:
        raise CommandError(f"--proxy: {error}; accepted are such as 127.0.0.1 and 172.16.0.0/12") from error


def _check_origins(address: str, port: int, origins: Sequence[str]) -> None:
    from dashboards.origins import OriginError, accepted_hosts  # noqa: PLC0415 - takes a second

    try:
        accepted_hosts(address, port, origins)
    except OriginError as error:
        raise CommandError(f"--origin: {error}") from error


def _check_folder(option: str, folder: Path | None, files: str) -> None:
    if folder is not None and not folder.is_dir():
        raise CommandError(f"{option} {folder}: is not a folder; accepted is one with {files}")


def _phones(address: str, port: int) -> tuple[str, int]:
    """Return where phones are taken. None reaches a loopback address: then all addresses are listened on."""
    from lab.live.phone.invitation import is_loopback  # noqa: PLC0415 - takes a second

    print(f"ins-lab: phones: choose the source “A phone” on the page Live; port {port}", file=sys.stderr)
    return ("0.0.0.0" if is_loopback(address) else address), port


def _take_live_algorithms(places: Sequence[str]) -> None:
    """Offer algorithms beside live streams; raise `CommandError` if one cannot be loaded."""
    from dashboards.algorithms import use_live_algorithms  # noqa: PLC0415 - help does not need it
    from lab.live.beside.live_algorithm import LiveAlgorithmError, load_live_algorithm  # noqa: PLC0415 - as above

    try:
        for place in places:
            load_live_algorithm(place)
    except LiveAlgorithmError as error:
        raise CommandError(f"--live-algorithm {error}") from error
    use_live_algorithms(places)


def _allow_devices(sources: Sequence[str]) -> None:
    """Allow the sources that --allow-device names."""
    from dashboards.devices import allow_devices  # noqa: PLC0415 - takes a second
    from lab.data.streams.transport import TransportError  # noqa: PLC0415 - takes a second

    try:
        allow_devices(sources)
    except TransportError as error:
        raise CommandError(f"--allow-device: {error}") from error


def read_password(path: Path) -> str:
    """Return the password in a file, its only line.

    Raises
    ------
    CommandError
        If the file cannot be read, or contains no acceptable password.
    """
    accepted = f"accepted is a file with one line of {LEAST_PASSWORD} to {MAX_PASSWORD} characters"
    if not path.is_file():
        raise CommandError(f"--password-file {path}: is not a file; {accepted}")
    try:
        with path.open("rb") as file:
            text = file.read(MAX_PASSWORD + 3).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise CommandError(f"--password-file {path}: cannot be read as text; {accepted}") from error
    password = text.removesuffix("\n").removesuffix("\r")
    if not LEAST_PASSWORD <= len(password) <= MAX_PASSWORD or not password.isprintable():
        raise CommandError(f"--password-file {path}: holds no password; {accepted}")
    return password


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
        reason = f"{(error.strerror or str(error)).lower()} at {address}"
        if error.errno == errno.EADDRINUSE and _is_served(address, port):
            reason = f"INS Lab runs there already: open http://localhost:{port}/"
        given = "make lab PORT=" if "MAKELEVEL" in os.environ else "--port "
        raise CommandError(f"--port {port}: {reason}; name another, such as {given}{free_port()}") from error


def _is_served(address: str, port: int) -> bool:
    """Say whether a laboratory answers at a port that is taken."""
    from http.client import HTTPConnection, HTTPException  # noqa: PLC0415 - rarely needed

    try:
        asked = HTTPConnection(address, port, timeout=1.0)
        asked.request("GET", "/health")
        return asked.getresponse().read(100) == b'{"status": "ready"}'
    except (OSError, HTTPException):
        return False


def free_port() -> int:
    """Return a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _has_run() -> bool:
    """Say whether Python has compiled, and kept, what the page imports: no installer need do so."""
    spec = importlib.util.find_spec("panel")
    return spec is not None and spec.cached is not None and Path(spec.cached).exists()


def _has_screen() -> bool:
    return sys.platform in {"darwin", "win32"} or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
