"""An address and an uploaded settings file come from a stranger: bounded, and read by declarations."""

from __future__ import annotations

import re
import threading
import time
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

import panel as pn
import pytest
from bokeh.document import Document
from hypothesis import given
from hypothesis import strategies as st
from panel.io.state import set_curdoc
from processor_time import takes_less_than

from dashboards import exchange
from dashboards.exchange import Files, experiment_of
from dashboards.headers import sockets
from dashboards.held_links import HeldLinks
from dashboards.notes import MOST, ROOM, notes_of_query, query_of_notes
from dashboards.query import experiment_of_query, query, view_of_query
from dashboards.session import Session
from dashboards.upstream.page_address import address_parts
from lab import Experiment, SettingError
from lab.views.flight_notes import LONGEST
from tests.security.conftest import Served

Uploading = tuple[Files, Session, Document]

SECONDS = 1.0
"""Time an address may take [s]: everybody else waits meanwhile."""

LONG = 60_000
"""Length of the longest address a server takes [characters]."""

HOSTILE = {
    "TOML after a seed": urlencode({"seed": "1\n" + "a" + ".a" * (LONG // 2) + " = 1"}),
    "TOML in place of a seed": urlencode({"seed": "{" + "a" + ".a" * (LONG // 2) + " = 1}"}),
    "many digits": f"seed={'1' * LONG}",
    "many hexadecimal digits": f"seed=0x{'f' * LONG}",
    "deep lists": f"sensors.gps.outages={'[' * LONG}",
    "a deep path": "a" + ".a" * (LONG // 2) + "=1",
    "a long path": f"{'a' * LONG}=1",
    "a long mission": f"mission={'a' * LONG}",
    "many unknown settings": "&".join(f"sed{number}=1" for number in range(190)),
    "many settings": "&".join("a=1" for _ in range(LONG // 4)),
    "a long view": urlencode(dict.fromkeys(("tab", "time", "zoom", "runs"), "9" * (LONG // 4))),
    "a long list": f"sensors.gps.outages=[{'[1,2],' * 9000}[3,4]]",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_address_costs_little_and_is_answered_in_a_sentence(name: str) -> None:
    with takes_less_than(SECONDS):
        experiment, problems = experiment_of_query(HOSTILE[name])
        assert len("".join(view_of_query(HOSTILE[name], ("Errors",))[1])) < 1000
    assert experiment.to_dict() == Experiment().to_dict() or name == "a long mission"
    assert problems or name in {"a long mission", "a long view"}
    assert len("".join(problems)) < 20_000


@pytest.mark.proof
@pytest.mark.parametrize(
    ("path", "host"),
    [
        ("/?seed=7", "[::1]:{}"),
        ("/?seed=7", "[fe80::1%25eth0]"),
        ("/?seed=7", "a:b:c"),
        (f"/?seed={'1' * 5000}", "localhost:{}"),
        ("/?seed=%C2%B2", "localhost:{}"),  # ², a digit that is no number for Python
        ("/?title=a?b", "localhost:{}"),
    ],
)
def test_a_page_is_made_whatever_its_address_is(served: Served, run: Any, path: str, host: str) -> None:
    before = len(served.log.read_text())

    async def tabs() -> str:
        async with served.visitor(path, Host=host.format(served.port)) as visitor:
            return visitor.tabs()

    assert run(tabs())
    assert "Traceback" not in served.log.read_text()[before:]


HOST = st.sampled_from(["localhost:5006", "[::1]:5006", "[::1]", "lab.example.org", "192.0.2.7:80", ""])


@given(HOST, st.text("ab/?=&.%", max_size=30))
def test_an_address_has_the_parts_that_the_standard_library_finds(host: str, rest: str) -> None:
    parts, expected = address_parts("http", host, f"/{rest}"), urlsplit(f"http://{host}/{rest}")
    assert parts["hostname"].strip("[]") == (expected.hostname or "")
    assert parts["port"] == str(expected.port or "")
    assert parts["pathname"] == expected.path
    assert parts["search"] == (f"?{expected.query}" if expected.query else "")
    assert parts["href"] == f"http:{f'//{host}' if host else ''}/{rest}"


@given(st.text(max_size=20), st.text(max_size=20))
def test_no_host_and_no_path_is_beyond_a_page(host: str, uri: str) -> None:
    assert address_parts("http", host, uri)["hostname"] in host


def test_a_policy_names_only_hosts_that_a_browser_accepts_there() -> None:
    for host, named in (("a.example:5006", "ws://a.example:5006 wss://a.example:5006"), ("[::1]:5006", "")):
        assert sockets(SimpleNamespace(host=host)) == named


def test_an_address_sets_only_what_it_names() -> None:
    experiment, problems = experiment_of_query(urlencode({"seed": "1\nmission = 'los_angeles'"}))
    assert (experiment.seed, experiment.mission) == (1, "montreal")
    assert "a whole number" in problems[0]


def test_what_an_address_was_made_of_comes_back() -> None:
    experiment = Experiment(mission="los_angeles", seed=2**32 - 1)
    experiment.update(
        {
            "sensors": {"gps": {"outages": [[3, 5], [7, 8.5]]}, "gyro": {"noise_density": [0.1, 0.2, 0.3]}},
            "navigator": {"p0": [1e-12] * 15, "states": 15, "smoother": True, "model": "psi"},
        }
    )
    again, problems = experiment_of_query(query(experiment))
    assert (again.to_dict(), problems) == (experiment.to_dict(), [])


@given(st.text(max_size=60), st.sampled_from([path for path, _, _ in Experiment().leaves()]))
def test_no_value_whatsoever_raises_anything_but_a_setting_error(text: str, path: str) -> None:
    experiment_of_query(urlencode({path: text}))


@pytest.fixture
def files() -> Iterator[Uploading]:
    pn.extension()
    document = Document()
    with set_curdoc(document):
        session = Session(document)
        made = Files(session, HeldLinks(session, document))
    yield made, session, document
    made.close()
    session.close()


def upload(files: Uploading, content: bytes, folder: Path) -> None:
    """Upload a file, and do what the thread that read it asks the page to do."""
    document, path = files[2], folder / "settings.toml"
    path.write_bytes(content)
    with set_curdoc(document):
        files[0]._uploaded([path])
    deadline = time.monotonic() + 10
    while not (asked := document.session_callbacks) and time.monotonic() < deadline:
        time.sleep(0.01)
    asked[0].callback()


def test_an_uploaded_file_is_read_in_a_thread(
    files: Uploading, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: list[threading.Thread] = []

    def read(content: bytes) -> Experiment:
        threads.append(threading.current_thread())
        return experiment_of(content)

    monkeypatch.setattr(exchange, "experiment_of", read)
    upload(files, b"seed = 5", tmp_path)
    assert files[1].experiment.seed == 5
    assert threads != [threading.current_thread()]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xff\xfe", "not text"),
        (b"#" * (2**20 + 1), "too large"),
        (b"seed = [", "not TOML"),
        (b"a" + b".a" * 20_000 + b" = 1", "a key of more than 8 parts"),
        (b"seed = " + b"1" * 5000, "a number or a key of more than 1000 characters"),
        (b"seed = " + b"[" * 5000, "brackets inside one another"),
        (b"<img src=x> = 1", "not TOML"),
        (b"sede = 1", "Did you mean seed"),
        (b"mission = '/etc/passwd'", "no such mission"),
    ],
)
def test_what_is_wrong_with_an_uploaded_file_is_said(
    files: Uploading, tmp_path: Path, content: bytes, words: str
) -> None:
    upload(files, content, tmp_path)
    assert re.search(words, files[1].problem)
    assert len(files[1].problem) < 1000


def test_what_is_in_an_uploaded_file_is_never_the_name_of_another(tmp_path: Path) -> None:
    secret = tmp_path / "secret.toml"
    secret.write_text("password = 'beware'")
    with pytest.raises(SettingError) as caught:
        experiment_of(str(secret).encode())
    assert "password" not in str(caught.value)


NOTES = {
    "markup": "note=" + quote("1-2:<img src=x onerror=alert(1)><script>alert(2)</script>"),
    "turned text": "note=" + quote("1-2:safe\u202etxt.exe\u2066"),
    "a long note": f"note=1-2:{'a' * LONG}",
    "a long time": f"note={'9' * LONG}:a",
    "many notes": "&".join(f"note={number}:a" for number in range(190)),
    "many wrong notes": "&".join("note=<b>" for _ in range(190)),
    "many fields": "&".join("note=1:a" for _ in range(LONG // 9)),
    "wide letters": "&".join(f"note=1:{quote('漢' * 200)}" for _ in range(30)),
}


@pytest.mark.parametrize("name", NOTES)
def test_notes_of_a_hostile_address_are_few_short_and_plain_text(name: str) -> None:
    with takes_less_than(SECONDS):
        notes, problems = notes_of_query(NOTES[name], "montreal")
        experiment, others = experiment_of_query(NOTES[name])
    assert len("".join(problems)) < 1000
    assert query(experiment) == ""
    assert len(notes) <= MOST
    assert len(query_of_notes(notes, "montreal")) <= ROOM
    for note in notes:
        assert len(note.text) <= LONGEST
        assert not any(unicodedata.category(letter).startswith("C") for letter in note.text)
    assert notes or problems or others
