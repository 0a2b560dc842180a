"""Server: the laboratory on one port of this computer."""

from __future__ import annotations

import contextlib
import secrets
import signal
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from distributed import Client

APP = Path(__file__).with_name("simulator.py")

CHECK = 5000
"""Time between two looks for sessions whose browser has left [ms]; Bokeh looks every 17 s."""
MAX_BODY = 2**16
"""Largest body of a request [bytes]: the password is the only body; files come over the websocket."""


def serve(
    port: int = 5006,
    address: str = "127.0.0.1",
    show: bool = False,
    algorithms: Sequence[str] = (),
    *,
    origins: Sequence[str] = (),
    visitors: str | None = None,
    password: str | None = None,
    lessons: Path | None = None,
    homework: Path | None = None,
    teacher: bool = False,
    warm: bool = True,
    client: Client | None = None,
) -> None:
    """Serve the simulator until interrupted; the 3-D view goes through the same port.

    Parameters
    ----------
    port
        Port to listen on.
    address
        Address to listen on; ``"0.0.0.0"`` is all of this computer's.
    show
        Whether to open the page in a browser.
    algorithms
        The operator's algorithms, as ``FILE.py:Name``, compared beside the built-in models.
    origins
        Further hosts whose pages may connect to the server, such as a proxy before it.
    visitors
        What visitors may do: ``"run"``, or ``"edit"`` for missions too. The default is edit if only this
        computer reaches the server, otherwise run.
    password
        Password for visitors; None for no password.
    lessons
        A teacher's folder with lessons; None without one.
    homework
        A teacher's folder with the keys of homework; None without one.
    teacher
        Whether somebody may teach: a link for teachers is printed, with which they lead classes.
    warm
        Whether a process beside the server compiles the filter ahead.
    client
        A client of a Dask cluster, on which pages run what has many runs; None for threads.
    """
    # These take a second; the first visitor should not wait for them.
    import panel as pn  # noqa: PLC0415
    from tornado.ioloop import IOLoop  # noqa: PLC0415

    import dashboards.page  # noqa: F401, PLC0415
    from dashboards.ensembles import use_cluster  # noqa: PLC0415
    from dashboards.headers import SecurityHeaders  # noqa: PLC0415
    from dashboards.messages import MAX_MESSAGE  # noqa: PLC0415
    from dashboards.origins import is_loopback  # noqa: PLC0415
    from dashboards.teaching.teacher import PATH, TeachHandler  # noqa: PLC0415
    from dashboards.upload import remove_all_here  # noqa: PLC0415
    from dashboards.upstream.component_files import PACKAGES, give_files_of_loaded_components  # noqa: PLC0415
    from dashboards.upstream.exits import outlive_exits  # noqa: PLC0415
    from dashboards.warming import Warming  # noqa: PLC0415

    _offer(algorithms, lessons, homework)
    use_cluster(client)
    loopback = is_loopback(address)
    _protect(address, visitors or ("edit" if loopback else "run"))
    warming = Warming() if warm else None
    _on_end(remove_all_here, *([warming.end] if warming else ()))
    admission = _admission(address, port, origins, password)
    give_files_of_loaded_components(PACKAGES)
    outlive_exits(IOLoop.current())
    where = "localhost" if loopback else address
    # The loop of events runs once the server listens: a browser that is opened before is refused.
    IOLoop.current().add_callback(print, _greeting(where, address, port, teacher=teacher), flush=True)
    try:
        pn.serve(
            {"/": str(APP)},
            port=port,
            address=address,
            show=show,
            title="INS Lab",
            verbose=False,
            transforms=[SecurityHeaders],
            extra_patterns=[(rf"/{PATH}", TeachHandler)],
            secret_key=secrets.token_bytes(32),
            sign_sessions=True,
            websocket_max_message_size=MAX_MESSAGE,
            check_unused_sessions_milliseconds=CHECK,
            http_server_kwargs={"max_body_size": MAX_BODY},
            **admission,
        )
    finally:
        if warming:
            warming.end()


def _offer(algorithms: Sequence[str], lessons: Path | None, homework: Path | None) -> None:
    """Offer the operator's algorithms, lessons and homework to all sessions; tidy and read the missions."""
    from dashboards.algorithms import use_algorithms  # noqa: PLC0415
    from dashboards.classroom import use_homework, use_lessons  # noqa: PLC0415
    from lab.missions import missions  # noqa: PLC0415
    from lab.missions.library import sweep_user_folder  # noqa: PLC0415

    use_algorithms(algorithms)
    use_lessons(lessons)
    use_homework(homework)
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


def _admission(address: str, port: int, origins: Sequence[str], password: str | None) -> dict[str, Any]:
    """Return the settings of the web application that admit hosts, and visitors with the password."""
    from dashboards.origins import SETTING, accepted_hosts  # noqa: PLC0415
    from dashboards.password import Password  # noqa: PLC0415

    admission: dict[str, Any] = {SETTING: accepted_hosts(address, port, origins)}
    if password is not None:
        admission |= {"auth_provider": Password(password, port), "cookie_secret": secrets.token_hex(32)}
    return admission


def _greeting(where: str, address: str, port: int, *, teacher: bool) -> str:
    """Return where the laboratory is, and the secret link of teachers if they are admitted."""
    from dashboards.teaching.teacher import PATH, admit_no_teacher, admit_teachers  # noqa: PLC0415
    from lab.live.phone.invitation import in_address, is_any, own_addresses  # noqa: PLC0415

    greeting = f"INS Lab is at http://{where}:{port}/ (stop it with Ctrl-C)"
    if not teacher:
        admit_no_teacher()
        return greeting
    named = (own_addresses() or ["localhost"])[0] if is_any(address) else where
    link = f"http://{in_address(named, port)}/{PATH}?key={admit_teachers(port)}"
    return f"{greeting}\nTeachers open {link} and show it to nobody"


def _on_end(*clean: Callable[[], None]) -> None:
    """Clean up when the system ends this process, then exit at once, even during a computation."""

    def end(number: int, _frame: FrameType | None) -> None:
        for part in clean:
            part()
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)

    with contextlib.suppress(ValueError):  # only the main thread receives signals
        for name in ("SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), end)
