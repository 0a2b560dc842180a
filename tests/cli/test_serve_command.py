"""``ins-lab serve``: ports, browsers, the page."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import pytest
from asking import RUN_SECONDS, ask, refused

from dashboards.serve_command import free_port


def test_serving_on_a_taken_port_names_a_free_one() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        refused(ask("serve", "--port", str(port), "--no-browser"), f"--port {port}", "in use", "name another")


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b'HTTP/1.1 200 OK\r\nContent-Length: 19\r\n\r\n{"status": "ready"}', "INS Lab runs there already"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}", "in use"),
        (b"220 mail\r\n", "in use"),
    ],
)
def test_who_has_the_port_and_how_to_name_another_under_make(
    monkeypatch: pytest.MonkeyPatch, answer: bytes, words: str
) -> None:
    def serve_once() -> None:
        connection, _ = taken.accept()
        with connection:
            connection.recv(1000)
            connection.sendall(answer)

    monkeypatch.setenv("MAKELEVEL", "1")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        server = threading.Thread(target=serve_once)
        server.start()
        port = str(taken.getsockname()[1])
        refused(ask("serve", "--port", port, "--no-browser"), words, "name another, such as make lab PORT=")
        server.join()


@pytest.mark.parametrize(
    "wrong",
    [
        ["--lessons", "nowhere"],
        ["--homework", "nowhere"],
        ["--password-file", "nowhere"],
        ["--origin", "http://a b"],
        ["--allow-device", "nowhere"],
        ["--algorithm", "nowhere.py:None"],
        ["--live-algorithm", "nowhere.py:None"],
    ],
    ids=lambda wrong: wrong[0],
)
def test_a_taken_port_does_not_hide_what_is_wrong_with_another_option(wrong: list[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        refused(ask("serve", "--port", str(port), "--no-browser", *wrong), wrong[1].partition(":")[0])


@pytest.mark.parametrize(
    ("screen", "flags", "show"), [("", [], False), (":0", [], True), (":0", ["--no-browser"], False)]
)
@pytest.mark.skipif(sys.platform != "linux", reason="DISPLAY tells of a screen on Linux only")
def test_the_page_opens_where_there_is_a_screen(
    monkeypatch: pytest.MonkeyPatch, screen: str, flags: list[str], show: bool
) -> None:

    asked: list[dict[str, Any]] = []
    monkeypatch.setattr("dashboards.server.serve", lambda **how: asked.append(how))
    monkeypatch.setenv("DISPLAY", screen)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    port = free_port()
    assert ask("serve", "--port", str(port), *flags).exit_code == 0
    expected = {"port": port, "address": "127.0.0.1", "show": show, "algorithms": ()}
    assert asked == [
        expected
        | {
            "origins": (),
            "proxies": (),
            "visitors": None,
            "password": None,
            "lessons": None,
            "homework": None,
            "teacher": False,
        }
        | {"warm": True, "client": None}
    ]


@pytest.mark.parametrize(
    ("wrong", "accepted"),
    [(["--proxy", "lab.example.org"], "172.16.0.0/12"), (["--processes", "0"], "greater than or equal to 1")],
)
def test_a_wrong_proxy_or_number_of_processes_is_refused(wrong: list[str], accepted: str) -> None:
    refused(ask("serve", "--no-browser", *wrong), wrong[0], accepted)


def _answers(address: str, within: float) -> bool:
    """Ask a server that may not listen yet, again and again for so many seconds."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        try:
            with urlopen(address, timeout=within) as answer:
                return bool(answer.status == 200 and b"INS Lab" in answer.read())
        except ConnectionError:
            continue
        except URLError as error:
            if not isinstance(error.reason, ConnectionError):
                raise
    return False


@pytest.mark.proof
@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0"])
def test_serving_answers_with_the_page(address: str) -> None:
    port = free_port()
    script = "from dashboards.command_line import main; main()"
    command = [
        sys.executable,
        "-c",
        script,
        "serve",
        "--port",
        str(port),
        "--address",
        address,
        "--no-browser",
        "--no-warm",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            # Said just before the server listens: to ask before would keep a processor busy for nothing.
            assert f":{port}/".encode() in process.stdout.readline()
            assert _answers(f"http://127.0.0.1:{port}/", RUN_SECONDS)
        finally:
            process.terminate()
