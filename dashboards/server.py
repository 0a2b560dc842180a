"""Server: the laboratory on one port of this computer."""

from __future__ import annotations

import secrets
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from bokeh.server.server import Server
    from distributed import Client

    from dashboards.handover import Handover, Secrets

APP = Path(__file__).with_name("simulator.py")

CHECK = 2000
"""Time between two looks for sessions whose browser has left [ms]; Bokeh looks every 17 s."""
MAX_BODY = 2**16
"""Largest body of a request [bytes]: the password is the only body; files come over the websocket."""


@dataclass(frozen=True)
class Laboratory:
    """What is served, and to whom.

    Attributes
    ----------
    port : int
        Port to listen on.
    address : str
        Address to listen on; ``"0.0.0.0"`` is all of this computer's.
    algorithms : sequence of str
        The operator's algorithms, as ``FILE.py:Name``, compared beside the built-in models.
    origins : sequence of str
        Further hosts whose pages may connect to the server, such as a proxy before it.
    proxies : sequence of str
        Addresses and networks of proxies that are believed; see `dashboards.forwarded`.
    visitors : str or None
        What visitors may do: ``"run"``, or ``"edit"`` for missions too. The default is edit if only this
        computer reaches the server, otherwise run.
    password : str or None
        Password for visitors; None for no password.
    lessons : pathlib.Path or None
        A teacher's folder with lessons; None without one.
    homework : pathlib.Path or None
        A teacher's folder with the keys of homework; None without one.
    teacher : bool
        Whether somebody may teach: a link for teachers is printed, with which they lead classes.
    warm : bool
        Whether a process beside the server compiles the filter ahead.
    """

    port: int = 5006
    address: str = "127.0.0.1"
    algorithms: Sequence[str] = ()
    origins: Sequence[str] = ()
    proxies: Sequence[str] = ()
    visitors: str | None = None
    password: str | None = None
    lessons: Path | None = None
    homework: Path | None = None
    teacher: bool = False
    warm: bool = True


class Start(NamedTuple):
    """What a server begins with.

    Attributes
    ----------
    token : str
        Token in the link of teachers; empty without teachers.
    handover : Handover
        What the server before this one has left, and this one will leave.
    secrets : Secrets
        By what it knows browsers.
    """

    token: str
    handover: Handover
    secrets: Secrets


def begin(laboratory: Laboratory) -> Start:
    """Take over what the server before this one has left."""
    from dashboards.handover import Handover  # noqa: PLC0415
    from dashboards.teaching.teacher import new_token  # noqa: PLC0415

    token = new_token() if laboratory.teacher else ""
    handover = Handover(laboratory.port, laboratory.password)
    return Start(token, handover, handover.secrets(token))


def serve(
    port: int = 5006,
    address: str = "127.0.0.1",
    show: bool = False,
    *,
    client: Client | None = None,
    **what: Any,
) -> None:
    """Serve the simulator until interrupted; the 3-D view goes through the same port.

    Parameters
    ----------
    port, address
        Port and address to listen on.
    show
        Whether to open the page in a browser.
    client
        A client of a Dask cluster, on which pages run what has many runs; None for threads.
    **what
        Further attributes of a `Laboratory`.
    """
    laboratory = Laboratory(port, address, **what)
    start = begin(laboratory)
    greeting = greeting_of(laboratory, start.token)
    serve_part(laboratory, start, client, greeting=greeting, port=laboratory.port, show=show)


def serve_part(
    laboratory: Laboratory,
    start: Start,
    client: Client | None = None,
    *,
    greeting: str = "",
    key: bytes = b"",
    connect: Callable[[Server], None] = lambda _server: None,
    **listening: Any,
) -> None:
    """Serve the simulator in this process, which may be one of several.

    Parameters
    ----------
    laboratory
        What is served.
    start
        What the server begins with.
    client
        A client of a Dask cluster; None for threads.
    greeting
        Printed once the server listens.
    key
        Signs the tokens of its pages; by default, a random one.
    connect
        Called with the server before its loop of events runs.
    **listening
        The port, and further arguments of Bokeh's server.
    """
    # These take a second; the first visitor should not wait for them.
    import panel as pn  # noqa: PLC0415
    from tornado.ioloop import IOLoop, PeriodicCallback  # noqa: PLC0415

    import dashboards.page  # noqa: F401, PLC0415
    from dashboards import ending  # noqa: PLC0415
    from dashboards.ensembles import use_cluster  # noqa: PLC0415
    from dashboards.forwarded import trust_proxies  # noqa: PLC0415
    from dashboards.handover import OFTEN  # noqa: PLC0415
    from dashboards.headers import OneRequest, SecurityHeaders  # noqa: PLC0415
    from dashboards.messages import MAX_MESSAGE  # noqa: PLC0415
    from dashboards.origins import is_loopback  # noqa: PLC0415
    from dashboards.process_place import is_first, is_one_of_several  # noqa: PLC0415
    from dashboards.teaching.class_record import open_classes, written_classes  # noqa: PLC0415
    from dashboards.teaching.teacher import PATH, TeachHandler, admit_holders  # noqa: PLC0415
    from dashboards.upload import remove_all_here  # noqa: PLC0415
    from dashboards.upstream.component_files import PACKAGES, give_files_of_loaded_components  # noqa: PLC0415
    from dashboards.upstream.exits import outlive_exits  # noqa: PLC0415
    from dashboards.warming import Warming  # noqa: PLC0415

    _offer(laboratory)
    use_cluster(client)
    _protect(
        laboratory.address, laboratory.visitors or ("edit" if is_loopback(laboratory.address) else "run")
    )
    trust_proxies(laboratory.proxies)
    admit_holders(laboratory.port, [bytes.fromhex(one) for one in start.secrets.teachers])
    warming = Warming() if laboratory.warm else None
    clean = iter([remove_all_here, *([warming.end] if warming else ())])
    loop: Any = IOLoop.current()
    give_files_of_loaded_components(PACKAGES)
    outlive_exits(loop)
    if is_first():
        open_classes(start.handover.classes)
    keeps = is_first() and (laboratory.teacher or laboratory.password is not None)

    def leave() -> None:
        if keeps:
            start.handover.leave(start.secrets, written_classes())

    server = pn.serve(
        {"/": str(APP)},
        address=laboratory.address,
        start=False,
        title="INS Lab",
        verbose=False,
        transforms=[SecurityHeaders, *([OneRequest] if is_one_of_several() else ())],
        extra_patterns=[(rf"/{PATH}", TeachHandler), (rf"/{ending.PATH}", ending.HealthHandler)],
        secret_key=key or secrets.token_bytes(32),
        sign_sessions=True,
        websocket_max_message_size=MAX_MESSAGE,
        check_unused_sessions_milliseconds=CHECK,
        http_server_kwargs={"max_body_size": MAX_BODY},
        **_admission(laboratory, start.secrets.cookie),
        **listening,
    )
    ending.end_on_signals(loop.asyncio_loop, server.get_sessions, leave, clean)
    PeriodicCallback(leave, OFTEN).start()
    connect(server)
    if greeting:
        # The loop of events runs once the server listens: a browser that is opened before is refused.
        loop.add_callback(print, greeting, flush=True)
    try:
        server.start()
        server.io_loop.start()
    finally:
        leave()
        for part in clean:
            part()


def _offer(laboratory: Laboratory) -> None:
    """Offer the operator's algorithms, lessons and homework to all sessions; tidy and read the missions."""
    from dashboards.algorithms import use_algorithms  # noqa: PLC0415
    from dashboards.classroom import use_homework, use_lessons  # noqa: PLC0415
    from lab.missions import missions  # noqa: PLC0415
    from lab.missions.library import sweep_user_folder  # noqa: PLC0415

    use_algorithms(laboratory.algorithms)
    use_lessons(laboratory.lessons)
    use_homework(laboratory.homework)
    sweep_user_folder()
    with warnings.catch_warnings(action="ignore"):
        missions()  # read here once, so that no page reads it again


def _protect(address: str, visitors: str) -> None:
    """Set what visitors may do, check where pages come from, and limit the log and the uploads."""
    from dashboards.log_limit import limit_log  # noqa: PLC0415
    from dashboards.origins import check_origins_of_pages  # noqa: PLC0415
    from dashboards.teaching.class_link import listen_on  # noqa: PLC0415
    from dashboards.upload import remove_abandoned  # noqa: PLC0415
    from dashboards.visitors import allow  # noqa: PLC0415

    allow(visitors)
    listen_on(address)
    limit_log()
    remove_abandoned()
    check_origins_of_pages()


def _admission(laboratory: Laboratory, cookie_secret: str) -> dict[str, Any]:
    """Return the settings of the web application that admit hosts, and visitors with the password."""
    from dashboards.origins import SETTING, accepted_hosts  # noqa: PLC0415
    from dashboards.password import Password  # noqa: PLC0415

    address, port, password = laboratory.address, laboratory.port, laboratory.password
    admission: dict[str, Any] = {SETTING: accepted_hosts(address, port, laboratory.origins)}
    if password is not None:
        admission |= {"auth_provider": Password(password, port), "cookie_secret": cookie_secret}
    return admission


def greeting_of(laboratory: Laboratory, token: str) -> str:
    """Return where the laboratory is, and the secret link of teachers if they are admitted."""
    from dashboards.teaching.teacher import PATH  # noqa: PLC0415
    from lab.live.phone.invitation import in_address, is_any, is_loopback, own_addresses  # noqa: PLC0415

    address, port = laboratory.address, laboratory.port
    where = "localhost" if is_loopback(address) else address
    greeting = f"INS Lab is at http://{where}:{port}/ (stop it with Ctrl-C)"
    if not token:
        return greeting
    named = (own_addresses() or ["localhost"])[0] if is_any(address) else where
    link = f"http://{in_address(named, port)}/{PATH}?key={token}"
    return f"{greeting}\nTeachers open {link} and show it to nobody"
