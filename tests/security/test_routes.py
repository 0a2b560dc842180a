"""Each route of a served laboratory is known; none imports what an address names, none ends the server."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from panel.io.server import ComponentResourceHandler
from panel.template import MaterialTemplate
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.testing import bind_unused_port
from tornado.web import Application, HTTPError, RequestHandler

from dashboards.upstream.component_files import PACKAGES, give_files_of_loaded_components
from dashboards.upstream.exits import outlive_exits
from tests.fuzz.addresses import MODULES
from tests.security.conftest import ROOT, START, Served, free_port

ROUTES = {
    "/favicon.ico": "IcoHandler: a file that is read at the start",
    "/ws": "PageSocket: asks for password, origin and a signed token",
    "/metadata": "MetadataHandler: asks for the password; the address of the page, and no session",
    "/?": "PageDocument: asks for the password; makes a session, but not for a part of another site's page",
    "/static/(?!extensions/)(.*)": "StaticHandler: BokehJS, which is public; of its folder alone",
    "/teach": "TeachHandler: compares the token of teachers",
    "/health": "HealthHandler: asks for nothing; says whether the server takes visitors, and no more",
    "/components/(.*)": "ComponentResourceHandler: asks for the password; files that loaded components list",
    "/login": "PasswordHandler: asks for the password; eight guesses a second",
    "/static/extensions/(.*)": "MultiRootStaticHandler: files of Panel, which are public; its folders alone",
    "/static/(.*)": "StaticHandler: as the other one, never reached but for extensions that do not exist",
}
"""Who answers what, by the regular expression of the address; each was looked at.

``panel serve`` has Panel's own for its page, which make a session for other sites, and a page with a list of
pages.
"""

LIST = """
import sys
import panel as pn
from bokeh.server.server import Server

def show(server):
    for rule in server._tornado.wildcard_router.rules:
        print("route", rule.matcher.regex.pattern.removesuffix("$"), rule.target.__name__)

if sys.argv[1] == "panel":
    from panel.command import main
    Server.run_until_shutdown = show
    sys.argv[1:] = ["serve", "dashboards/simulator.py", "--port", "0"]
    main()
else:
    serve = pn.serve
    pn.serve = lambda pages, **how: sys.exit(show(serve(pages, **{**how, "port": 0})))
    import dashboards
    dashboards.serve(password="open sesame", teacher=True, warm=False)
"""


def routes(way: str) -> dict[str, set[str]]:
    """Return the handlers of a server by the regular expression of their addresses."""
    asked = subprocess.run(
        [sys.executable, "-c", LIST, way], cwd=ROOT, capture_output=True, text=True, check=True, timeout=START
    )
    found: dict[str, set[str]] = {}
    for line in asked.stdout.splitlines():
        if line.startswith("route "):
            _, pattern, handler = line.split()
            found.setdefault(pattern, set()).add(handler)
    return found


@pytest.mark.proof
def test_each_route_of_a_served_laboratory_was_looked_at() -> None:
    found = routes("lab")
    assert found.pop("/?") == {"PageDocument", "RootHandler"}  # the second is never reached
    looked_at = {pattern: {reason.partition(":")[0]} for pattern, reason in ROUTES.items()}
    del looked_at["/?"]
    assert found == looked_at


def test_panel_serve_has_no_route_that_was_not_looked_at() -> None:
    found = routes("panel")
    assert found.pop("/?") == {"RootHandler"}
    assert found.pop("/simulator/ws") == {"WSHandler"}
    assert found.pop("/simulator/static/(.*)") == {"StaticHandler"}
    assert found.pop("/simulator/autoload.js") == {"AutoloadJsHandler"}
    assert found.pop("/simulator/?") == {"DocHandler"}
    known = {pattern: reason.partition(":")[0] for pattern, reason in ROUTES.items()}
    for pattern, (handler,) in found.items():
        assert known[pattern.removeprefix("/simulator")] == handler


def ask(port: int, path: str) -> int:
    """Return the status a request is answered with; 0 if the server ends instead."""
    way = HTTPConnection("127.0.0.1", port, timeout=START)
    try:
        way.request("GET", path)
        return way.getresponse().status
    except ConnectionError:
        return 0
    finally:
        way.close()


@pytest.mark.parametrize("module", MODULES)
def test_no_address_imports_a_module(served: Served, module: str) -> None:
    before = len(served.log.read_text())
    for rest in ("x/__css__/y/z", "main/_css/a", "x", ""):
        assert ask(served.port, f"/components/{module}/{rest}") in {400, 404}
    assert ask(served.port, "/metadata") == 200
    assert "Traceback" not in served.log.read_text()[before:]


LISTED = "panel.template.material/MaterialTemplate/_css/material.css"
"""A file that a component of Panel lists, whose module is loaded with Panel."""


def test_a_listed_file_of_a_loaded_component_is_given_behind_the_password(
    served: Served, locked: Served
) -> None:
    assert ask(served.port, f"/components/{LISTED}") == 200
    assert ask(locked.port, f"/components/{LISTED}") == 403
    assert ask(locked.port, "/components/unittest.__main__/x/__css__/y/z") == 403


@pytest.fixture
def find() -> Iterator[Any]:
    """Return what finds the file of an address, as it is on a laboratory."""
    handler: Any = ComponentResourceHandler
    before = getattr(handler, "packages", None)
    give_files_of_loaded_components(PACKAGES)
    yield lambda path: handler.parse_url_path(handler, path)
    handler.packages = before


@pytest.mark.proof
def test_whatever_of_a_module_is_named_a_file_or_a_refusal_is_the_answer(find: Any) -> None:
    given = 0
    for name in list(sys.modules):
        if name.partition(".")[0] not in {*PACKAGES, "bokeh", "param"}:
            continue
        for inside in [*vars(sys.modules[name] or object), "", "%00", "é"]:
            for attribute in [*ComponentResourceHandler._resource_attrs, "__dict__", "name"]:
                for file in ("x.css", "css/x", "../../__init__.py", "material.css"):
                    try:
                        path = Path(find(f"{name}/{inside}/{attribute}/{file}"))
                    except HTTPError as error:
                        assert error.status_code in {400, 403, 404}
                    else:
                        given += 1
                        assert path.is_file(), path
                        assert name.partition(".")[0] in PACKAGES
    assert given


def test_a_component_of_another_package_gives_no_file(find: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    declared = {"_css": [Path(__file__)], "__module__": "another"}
    own = ModuleType("another")
    vars(own).update(__file__=__file__, Own=type("Own", (MaterialTemplate,), declared))
    monkeypatch.setitem(sys.modules, "another", own)
    with pytest.raises(HTTPError, match="404"):
        find("another/Own/_css/test_routes.py")
    monkeypatch.setattr(ComponentResourceHandler, "packages", None)
    assert find("another/Own/_css/test_routes.py") == __file__


@pytest.mark.proof
def test_panel_serve_imports_nothing_before_a_page_is_open_and_after(tmp_path: Path) -> None:
    """With what ``pyproject.toml`` declares, also if this installation is older."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]
    installed = tmp_path / "ins_lab-0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: ins-lab\nVersion: 0\n")
    lines = [f"[{group}]\n" + "\n".join(map(" = ".join, named.items())) for group, named in declared.items()]
    (installed / "entry_points.txt").write_text("\n".join(lines))
    port, log = free_port(), tmp_path / "log"
    command = [sys.executable, "-m", "panel", "serve", "dashboards/simulator.py", "--port", str(port)]
    own = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))}
    with (
        log.open("wb") as sink,
        subprocess.Popen(command, cwd=ROOT, stdout=sink, stderr=sink, env=own) as process,
    ):
        try:
            while "Starting Bokeh server with process id" not in log.read_text():
                assert process.poll() is None, log.read_text()
            for page in ("", "/simulator"):
                if page:
                    assert ask(port, page) == 200
                for module in MODULES:
                    assert ask(port, f"/components/{module}/x/__css__/y/z") == 404
        finally:
            process.kill()


class Exit(RequestHandler):
    """Asks for an exit before or after it has answered, or in a callback."""

    def get(self, when: str) -> None:
        """Ask for it."""
        if when == "later":
            IOLoop.current().add_callback(sys.exit, "later")
            return
        if when == "after":
            self.finish("answered")
        sys.exit(when)


def test_whatever_asks_for_an_exit_the_server_goes_on() -> None:
    answers: dict[str, int] = {}
    address: list[int] = []
    ready, done = threading.Event(), threading.Event()

    async def serve() -> None:
        sockets = bind_unused_port()
        server = HTTPServer(Application([("/(.*)", Exit)]))
        server.add_socket(sockets[0])
        outlive_exits(IOLoop.current())
        outlive_exits(IOLoop.current())  # a second page does so too
        address.append(sockets[1])
        ready.set()
        await asyncio.to_thread(done.wait, START)
        server.stop()

    with ThreadPoolExecutor(1) as pool:
        serving = pool.submit(asyncio.run, serve())
        assert ready.wait(START)
        for when in ("now", "after", "later", "now"):
            answers[when] = ask(address[0], f"/{when}")
        done.set()
        serving.result(START)
    assert answers == {"now": 500, "after": 200, "later": 200}


def test_a_command_that_is_imported_does_not_run() -> None:
    import_module("dashboards.__main__")
