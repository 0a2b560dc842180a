"""What visitors may do is decided by whoever serves, and the server holds them to it."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import TestResult
from urllib.parse import quote

import pytest
from bokeh.document import Document
from panel.io.state import set_curdoc
from tornado.testing import AsyncHTTPTestCase
from tornado.web import Application, RequestHandler

import dashboards
from dashboards import password as passwords
from dashboards.pages.missions.missions import PARTS, Missions
from dashboards.password import COOKIE, Password
from dashboards.serve_command import free_port
from dashboards.session import Session
from dashboards.visitors import VARIABLE, allow, may_edit
from lab.missions import missions
from lab.views.figures import TimeAxis
from tests.cli.asking import ask, refused
from tests.security.conftest import Served
from tests.security.watch import say


@pytest.fixture
def missions_page(request: pytest.FixtureRequest) -> Iterator[Missions]:
    """Return the page of missions, for visitors who may do what the test says."""
    allow(request.param)
    document = Document()
    with set_curdoc(document):
        made = Missions(TimeAxis(), Session(document))
        yield made
    made.close()


def models(view: Any) -> str:
    """Return what is in a page, buttons by their words."""
    return " ".join(str(getattr(part, "label", "")) for part in view.select())


@pytest.mark.parametrize("missions_page", ["run"], indirect=True)
def test_who_runs_can_change_no_mission_with_messages_made_by_hand(
    missions_page: Missions, mine: Path
) -> None:
    library = missions_page._part
    for title in PARTS:
        missions_page._choice.param.update(options=list(PARTS), value=title)  # as a browser can say
        assert missions_page._part is library
        assert missions_page._stage.objects == [library.view]
    assert list(missions_page._parts) == ["Library"]
    library._act("edit", "mine")
    library._act("delete", "mine")
    assert not library._changing.view.open
    assert not library._deleting.view.open
    assert not {"Save", "Delete"} & set(models(missions_page.view).split())
    assert "mine" in missions()


@pytest.mark.parametrize("missions_page", ["edit"], indirect=True)
def test_who_edits_has_all_parts(missions_page: Missions, mine: Path) -> None:
    for title in PARTS:
        missions_page._choice.value = title
    assert list(missions_page._parts) == list(PARTS)
    missions_page._choice.value = "Library"
    missions_page._part._act("delete", "mine")
    assert missions_page._part._deleting.view.open
    assert {"Save", "Delete"} <= set(models(missions_page.view).split())


def test_where_nothing_was_decided_visitors_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert not may_edit()
    for wrong in ("Edit", "", "all"):
        monkeypatch.setenv(VARIABLE, wrong)
        assert not may_edit()
        with pytest.raises(ValueError, match="accepted is one of run, edit"):
            allow(wrong)


@pytest.mark.parametrize("choice", ["run", "edit"])
def test_the_server_overrules_the_environment(monkeypatch: pytest.MonkeyPatch, choice: str) -> None:
    monkeypatch.setenv(VARIABLE, "edit" if choice == "run" else "run")
    allow(choice)
    assert may_edit() == (choice == "edit")


@pytest.mark.parametrize(
    ("address", "visitors", "edit"),
    [
        ("127.0.0.1", None, True),
        ("::1", None, True),
        ("localhost", "run", False),
        ("0.0.0.0", None, False),
        ("192.0.2.7", None, False),
        ("0.0.0.0", "edit", True),
    ],
)
def test_others_run_unless_it_is_said(
    monkeypatch: pytest.MonkeyPatch, address: str, visitors: str | None, edit: bool
) -> None:
    import panel as pn

    from dashboards import ending, origins

    monkeypatch.setenv(VARIABLE, "run")
    asked: list[dict[str, Any]] = []
    loop = SimpleNamespace(start=lambda: None)
    made = SimpleNamespace(get_sessions=list, start=lambda: None, io_loop=loop)

    def serve(_apps: object, **how: Any) -> object:
        asked.append(how)
        return made

    monkeypatch.setattr(pn, "serve", serve)
    monkeypatch.setattr(origins, "check_origins_of_pages", lambda: None)
    monkeypatch.setattr(ending, "end_on_signals", lambda *_how: None)
    dashboards.serve(address=address, visitors=visitors, warm=False)
    assert may_edit() == edit
    (how,) = asked
    assert how["sign_sessions"]
    assert len(how["secret_key"]) >= 16


def test_a_visitor_of_a_server_for_others_finds_no_import(served: Served, run) -> None:
    """One who turns to the missions, and then sends for the part that nobody offers."""

    async def ask_for_import() -> str:
        async with served.visitor("/?tab=Missions") as visitor:
            await say(visitor, "document_ready")
            while not (found := list(visitor.models(value="Library"))):
                await visitor.pull()
            for title in ("Import", "X-Plane", "Library"):
                assert (await visitor.change(found[0]["id"], value=title))["msgtype"] == "OK"
            await visitor.pull()
            return json.dumps(visitor.document)

    document = run(ask_for_import())
    assert "words of title, origin, tags" in document  # the library
    for offered in ("files of one flight", "Ending the recording", "49000", "Edit mission", "Delete mission"):
        assert offered not in document


@pytest.mark.parametrize("text", ["short", "", "two\nlines of it", "x" * 1025, "tab\tin it", "\x00" * 9])
def test_a_password_file_holds_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "password"
    path.write_text(text)
    refused(
        ask("serve", "--no-browser", "--password-file", str(path)), "--password-file", "accepted is a file"
    )


@pytest.mark.parametrize("path", ["/dev/zero", "/nowhere/at/all", "/"])
def test_what_is_no_file_holds_no_password(path: str) -> None:
    refused(ask("serve", "--no-browser", "--password-file", path), "is not a file")


def test_options_reach_the_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "password"
    path.write_text("an open sesame\n")
    asked: list[dict[str, Any]] = []
    monkeypatch.setattr("dashboards.server.serve", lambda **how: asked.append(how))
    flags = ["--password-file", str(path), "--visitors", "edit", "--origin", "a.example", "--origin", "b:1"]
    flags += ["--port", str(free_port())]
    assert ask("serve", "--no-browser", *flags).exit_code == 0
    (how,) = asked
    assert (how["password"], how["visitors"]) == ("an open sesame", "edit")
    assert how["origins"] == ["a.example", "b:1"]
    refused(ask("serve", "--no-browser", "--visitors", "own"), "--visitors", "run", "edit")


@pytest.mark.parametrize(
    ("asked", "led"),
    [
        ("/?seed=7", "/?seed=7"),
        ("//evil.example", "/"),
        ("https://evil.example", "/"),
        ("/\\evil.example", "/"),
        ("javascript:alert(1)", "/"),
        ("/a\r\nSet-Cookie: b", "/"),
        ("http://[", "/"),
    ],
)
def test_after_the_password_one_stays_on_this_server(asked: str, led: str) -> None:
    assert passwords._own(asked) == led


class Page(RequestHandler):
    """A page behind the password."""

    def get(self) -> None:
        """Return whether the visitor is let in."""
        user = self.application.auth_provider.get_user(self)
        self.set_status(200 if user else 401)


class PasswordTest(AsyncHTTPTestCase):
    """The door, without the house behind it."""

    def run(self, result: TestResult | None = None) -> TestResult | None:
        """Run a test in a thread: in that of a browser test before it, a loop of events may still run."""
        with ThreadPoolExecutor(max_workers=1) as pool:
            return pool.submit(super().run, result).result()

    def get_app(self) -> Application:
        """Return a page and what asks for its password."""
        provider = Password("open sesame", 5006)
        application = Application(
            [(provider.login_url, provider.login_handler), ("/", Page)], cookie_secret="k" * 32
        )
        application.auth_provider = provider  # type: ignore[attr-defined]  # as Bokeh's application has
        return application

    def give(self, password: str, after: str = "/?seed=7"):
        """Return what is answered to a password."""
        return self.fetch(
            f"/login?next={quote(after)}",
            method="POST",
            body=f"password={quote(password)}",
            follow_redirects=False,
        )

    def test_the_password_opens_the_page(self) -> None:
        """The password alone does, and the cookie it is answered with."""
        assert b"Password" in self.fetch("/login").body
        assert self.fetch("/").code == 401
        answer = self.give("open sesame")
        assert (answer.code, answer.headers["Location"]) == (302, "/?seed=7")
        cookie = answer.headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Lax" in cookie
        given = re.match(rf"{COOKIE}_5006=[^;]+", cookie)
        assert given is not None
        assert self.fetch("/", headers={"Cookie": given[0]}).code == 200
        assert self.fetch("/", headers={"Cookie": f"{COOKIE}_5006=visitor"}).code == 401
        assert self.give("open sesame", "//evil.example").headers["Location"] == "/"

    def test_another_password_opens_nothing_and_takes_its_time(self) -> None:
        """However near it is; of many at once, some are not even looked at."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(passwords, "PENALTY", 0.01)
            for wrong in ("", "open sesam", "open sesame ", "ø"):
                answer = self.give(wrong)
                assert answer.code == 403
                assert "Set-Cookie" not in answer.headers
        provider = self._app.auth_provider
        assert provider.waiting == 0
        provider.waiting = passwords.TRIES
        assert self.give("open sesame").code == 429


def test_a_request_has_no_large_body(served: Served) -> None:
    """It is refused by its announced length, before it is read."""
    with socket.create_connection(("127.0.0.1", served.port), timeout=60) as way:
        way.sendall(b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000000\r\n\r\n")
        assert b" 400 " in way.recv(100)
