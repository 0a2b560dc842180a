"""The command line: what it answers, where, and with which exit code, to right and wrong arguments."""

from __future__ import annotations

import io
import json
import math
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import pytest
from typer.testing import CliRunner
from typer.testing import Result as Answer

from lab import cli
from lab.missions import mission
from lab.terminal import Progress, table

RUN_SECONDS = 60


def _ask(*arguments: str) -> Answer:
    return CliRunner().invoke(cli.app, list(arguments))


def _process(*arguments: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    script = "from lab.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", script, *arguments],
        capture_output=True,
        env={**os.environ, **environment},
        timeout=RUN_SECONDS,
        check=False,
    )


def _refused(answer: Answer, *words: str) -> None:
    assert answer.exit_code == 2, answer.output
    assert answer.stdout == ""
    assert "Traceback" not in answer.stderr
    for word in words:
        assert word in answer.stderr


def test_alone_it_prints_help_with_every_command_and_examples() -> None:
    answer = _ask()
    assert answer.exit_code == 0
    for word in ("missions", "run", "fly", "serve", "--version", "Examples:", "ins-lab run montreal"):
        assert word in answer.stdout


@pytest.mark.parametrize("command", ["missions", "run", "fly", "serve"])
def test_every_command_has_help(command: str) -> None:
    answer = _ask(command, "--help")
    assert answer.exit_code == 0
    assert answer.stdout.startswith(f"Usage: ins-lab {command}")


def test_the_version_is_the_one_installed() -> None:
    assert _ask("--version").stdout.startswith("ins-lab 0.")


def test_missions_are_a_table() -> None:
    answer = _ask("missions")
    header, *rows = answer.stdout.splitlines()
    assert header.split() == ["name", "title", "duration", "origin"]
    montreal = next(row for row in rows if row.startswith("montreal"))
    assert f"{mission('montreal').duration:.1f} s" in montreal
    assert montreal.index("Montréal") == header.index("title")


def test_missions_as_json() -> None:
    entries = {entry["name"]: entry for entry in json.loads(_ask("missions", "--json").stdout)}
    assert {"montreal", "los_angeles"} <= entries.keys()
    assert entries["montreal"]["duration_s"] == mission("montreal").duration
    assert entries["montreal"]["can_fly"] is True


def test_a_broken_mission_of_ones_own_is_named_and_the_rest_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path))
    (tmp_path / "cut.toml").write_text('title = "Cut"\nrecording = "cut.csv"\n')
    (tmp_path / "cut.csv").write_text("time_s\n0\n")
    (tmp_path / "odd.toml").write_text("title = 3\n")
    answer = _ask("missions")
    assert answer.exit_code == 0
    assert "montreal" in answer.stdout
    assert "cut" not in answer.stdout
    assert "cut" in answer.stderr
    assert "odd.toml" in answer.stderr
    assert [entry["name"] for entry in json.loads(_ask("missions", "--json").stdout)] == [
        "los_angeles",
        "montreal",
    ]


def test_a_run_shows_its_errors_as_an_aligned_table() -> None:
    answer = _ask("run", "los_angeles", "--seed", "5")
    assert answer.exit_code == 0
    header, *rows = answer.stdout.splitlines()
    assert header.split()[:4] == ["quantity", "unit", "rms", "max"]
    ends = {len(line) for line in (header, *rows)}
    assert len(ends) == 1, "the last column of numbers is not aligned to the right"


def test_a_run_as_json_holds_what_repeats_it(tmp_path: Path) -> None:
    arguments = ["run", "los_angeles", "--set", "sensors.gyro.noise_density=0.02", "--seed", "5", "--json"]
    first = json.loads(_ask(*arguments).stdout)
    assert first["mission"] == "los_angeles"
    assert first["seed"] == 5
    assert first["settings"]["sensors"]["gyro"]["noise_density"] == [0.02] * 3
    assert all(row["rms"] <= row["max"] for row in first["summary"])
    assert json.loads(_ask(*arguments).stdout) == first
    other = json.loads(_ask(*arguments[:-2], "6", "--json").stdout)
    assert other["summary"] != first["summary"]


def test_settings_come_from_the_file_then_from_set_then_from_the_options(tmp_path: Path) -> None:
    config = tmp_path / "settings.toml"
    config.write_text(
        'mission = "montreal"\nseed = 3\n[sensors.gps]\nperiod = 2.0\n[navigator]\nr_scale = 4\n'
    )
    answer = _ask(
        *(
            "run",
            "los_angeles",
            "--config",
            str(config),
            "--set",
            "navigator.r_scale=9",
            "--seed",
            "8",
            "--json",
        )
    )
    settings = json.loads(answer.stdout)["settings"]
    assert settings["mission"] == "los_angeles"
    assert settings["seed"] == 8
    assert settings["sensors"]["gps"]["period"] == 2.0
    assert settings["navigator"]["r_scale"] == 9


def test_a_flight_csv_is_a_mission_too(tmp_path: Path) -> None:
    source = mission("los_angeles").recording_path
    copy = shutil.copy(source, tmp_path / "mine.csv.gz")
    named = json.loads(_ask("run", "los_angeles", "--json").stdout)
    bare = json.loads(_ask("run", str(copy), "--json").stdout)
    assert bare["summary"] == named["summary"]


def test_a_folder_with_one_mission_is_that_mission(tmp_path: Path) -> None:
    source = mission("los_angeles")
    assert source.path is not None
    for path in (source.path, source.recording_path):
        shutil.copy(path, tmp_path)
    assert _ask("run", str(tmp_path), "--json").exit_code == 0
    shutil.copy(source.path, tmp_path / "second.toml")
    _refused(_ask("run", str(tmp_path)), "second.toml", "los_angeles.toml")


def test_the_result_is_written_once_and_replaced_only_when_told(tmp_path: Path) -> None:
    import xarray

    out = tmp_path / "run.nc"
    answer = _ask("run", "los_angeles", "--out", str(out), "--json")
    assert answer.exit_code == 0, answer.stderr
    assert json.loads(answer.stdout)["out"] == str(out)
    with xarray.open_datatree(out) as tree:
        assert tree.groups
    before = out.read_bytes()
    _refused(_ask("run", "los_angeles", "--out", str(out)), "exists already", "--force")
    assert out.read_bytes() == before
    assert _ask("run", "los_angeles", "--out", str(out), "--force", "--seed", "9").exit_code == 0
    assert out.read_bytes() != before
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["sail"], ["no command 'sail'", "missions, run, fly, serve"]),
        (["--nonsense"], ["--nonsense"]),
        (["run"], ["MISSION"]),
        (["run", "montrael"], ["Did you mean montreal?", "los_angeles"]),
        (["run", "nowhere.csv"], ["nowhere.csv", "no such file"]),
        (["run", "a\0b"], ["no mission"]),
        (["run", "a" * 300], ["a" * 300]),
        (["run", "montreal", "extra"], ["extra"]),
        (["run", "montreal", "--seed", "x"], ["--seed", "integer"]),
        (["run", "montreal", "--seed", "-1"], ["seed = -1", "from 0 to 4294967295"]),
        (["run", "montreal", "--set", "sensors.gyro.noise=1"], ["Did you mean sensors.gyro.noise_density?"]),
        (["run", "montreal", "--set", "sensors.gyro.noise_density=99"], ["from 0 to 10 °/s/√Hz"]),
        (["run", "montreal", "--set", "sensors.gyro.noise_density"], ["path=value"]),
        (["run", "montreal", "--set", "navigator.model=psy"], ["accepted is one of", "phi"]),
        (["run", "montreal", "--config", "nowhere.toml"], ["nowhere.toml", "cannot be read"]),
        (["run", "montreal", "--out", "run.csv"], ["ending in .nc"]),
        (["run", "montreal", "--out", "nowhere/run.nc"], ["no folder nowhere"]),
        (["fly", "montrael"], ["Did you mean montreal?"]),
        (["serve", "--port", "0"], ["--port"]),
        (["serve", "--port", "65536"], ["--port", "65535"]),
        (["serve", "--address", "8.8.8.8"], ["not an address of this computer"]),
        (["serve", "extra"], ["extra"]),
    ],
)
def test_what_is_wrong_is_answered_with_what_is_accepted(arguments: list[str], words: list[str]) -> None:
    _refused(_ask(*arguments), *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[sensors.gyro]\nnoise = 1\n", ["sensors.gyro.noise", "Did you mean"]),
        ("[sensors.gps]\nperiod = 0\n", ["sensors.gps.period = 0", "from 0.05 to 60 s"]),
        ("sensors = 3\n", ["is a group of settings"]),
        ("a = \n", ["TOML", "line 1"]),
        ("\udcff", ["TOML"]),
        ("a = " + "[" * 5000, ["TOML"]),
    ],
)
def test_a_bad_file_of_settings_is_named(tmp_path: Path, text: str, words: list[str]) -> None:
    config = tmp_path / "settings.toml"
    config.write_bytes(text.encode("utf-8", "surrogateescape"))
    _refused(_ask("run", "montreal", "--config", str(config)), "settings.toml", *words)


def test_a_broken_flight_is_named_with_row_and_column(tmp_path: Path) -> None:
    flight = tmp_path / "flight.csv"
    flight.write_text("time_s,latitude_deg\n0,1\n")
    _refused(_ask("run", str(flight)), "flight.csv", "longitude_deg")


def test_flying_writes_a_mission_and_replaces_none(tmp_path: Path) -> None:
    pytest.importorskip("jsbsim")
    short = tmp_path / "short.toml"
    short.write_text(
        'title = "Short"\nrecording = "short.csv.gz"\n[flight]\naircraft = "c172p"\nduration_s = 30.0\n'
        "[flight.runway]\nlatitude_deg = 45.0\nlongitude_deg = 7.0\nheight_m = 300.0\nheading_deg = 90.0\n"
        '[[flight.manoeuvres]]\ndo = "take_off"\n'
    )
    answer = _ask("fly", str(short), "--seed", "4", "--out", str(tmp_path / "flown"))
    assert answer.exit_code == 0, answer.stderr
    flown = mission(tmp_path / "flown" / "short.toml")
    assert flown.duration == pytest.approx(30, abs=0.06)
    _refused(_ask("fly", str(short), "--seed", "4", "--out", str(tmp_path / "flown")), "short.csv.gz")
    assert _ask("fly", str(short), "--seed", "4", "--out", str(tmp_path / "flown"), "--force").exit_code == 0


def test_serving_on_a_taken_port_names_a_free_one() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        _refused(
            _ask("serve", "--port", str(port), "--no-browser"), f"--port {port}", "in use", "name another"
        )


@pytest.mark.parametrize(
    ("screen", "flags", "show"), [("", [], False), (":0", [], True), (":0", ["--no-browser"], False)]
)
@pytest.mark.skipif(sys.platform != "linux", reason="DISPLAY tells of a screen on Linux only")
def test_the_page_opens_where_there_is_a_screen(
    monkeypatch: pytest.MonkeyPatch, screen: str, flags: list[str], show: bool
) -> None:
    import dashboards

    asked: list[dict[str, Any]] = []
    monkeypatch.setattr(dashboards, "serve", lambda **how: asked.append(how))
    monkeypatch.setenv("DISPLAY", screen)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    port = cli._free_port()
    assert _ask("serve", "--port", str(port), *flags).exit_code == 0
    assert asked == [{"port": port, "address": "127.0.0.1", "show": show}]


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


@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0"])
def test_serving_answers_with_the_page(address: str) -> None:
    port = cli._free_port()
    script = "from lab.cli import main; main()"
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
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert _answers(f"http://127.0.0.1:{port}/", RUN_SECONDS)
        finally:
            process.terminate()
        assert process.stdout is not None
        assert f":{port}/".encode() in process.stdout.readline()


def test_json_is_all_there_is_on_standard_output() -> None:
    done = _process("run", "los_angeles", "--json")
    assert done.returncode == 0, done.stderr.decode()
    assert json.loads(done.stdout)["mission"] == "los_angeles"


def test_refusals_of_a_process_are_on_standard_error_with_code_2() -> None:
    done = _process("run", "montreal", "--set", "sensors.gyro.noise_density=99")
    assert done.returncode == 2
    assert done.stdout == b""
    assert b"Traceback" not in done.stderr


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1"])
def test_units_do_not_break_a_terminal_that_lacks_their_signs(encoding: str) -> None:
    done = _process("run", "montreal", "--set", "sensors.gyro.noise_density=99", PYTHONIOENCODING=encoding)
    assert done.returncode == 2
    assert "/s/sqrtHz" in done.stderr.decode(encoding)
    assert _process("missions", PYTHONIOENCODING=encoding).returncode == 0


def test_a_reader_that_leaves_early_is_no_error() -> None:
    command = [sys.executable, "-c", "from lab.cli import main; main()", "missions"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert b"Traceback" not in process.stderr.read()


def test_a_wide_last_column_goes_on_below_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    lines = table(
        ("name", "text"), [("a", "one two three four five six seven eight nine ten"), ("b", "")]
    ).splitlines()
    assert lines[0] == "name  text"
    assert lines[1].startswith("a     one two")
    assert lines[2].startswith("      ")
    assert all(len(line) <= 40 for line in lines)
    assert lines[-1] == "b"


class _Screen(io.StringIO):
    """A terminal that says when it has been written to."""

    def __init__(self) -> None:
        super().__init__()
        self.written = threading.Event()

    def isatty(self) -> bool:
        return True

    def flush(self) -> None:
        self.written.set()


def test_quick_work_shows_no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lab.terminal.PATIENCE", 60)
    screen = _Screen()
    with Progress("working", screen) as progress:
        progress("halfway", 0.5)
    assert screen.getvalue() == ""


def test_slow_work_follows_the_news_and_leaves_no_trace_in_a_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("lab.terminal.PATIENCE", 0)
    screen = _Screen()
    with Progress("montreal", screen) as progress:
        assert screen.written.wait(10)
        progress("flying", 0.25)
        progress("flying", 0.5)
        progress("landing", 1.0)
    shown = screen.getvalue().split("\r\x1b[K")
    assert shown[-1] == ""
    lines = [line.rpartition(",")[0] for line in shown[1:-1]]
    assert list(dict.fromkeys(lines)) == [
        "montreal ... 0%",
        "montreal: flying ... 25%",
        "montreal: flying ... 50%",
    ]


def test_slow_work_tells_each_step_once_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lab.terminal.PATIENCE", 0)
    log = _Screen()
    monkeypatch.setattr(log, "isatty", lambda: False)
    with Progress("montreal", log) as progress:
        assert log.written.wait(10)
        progress("flying", 0.25)
        progress("flying", 0.5)
    assert log.getvalue() == "montreal ...\nmontreal: flying ...\n"


def test_numbers_json_does_not_know_are_null() -> None:
    assert cli._finite(math.nan) is None
    assert cli._finite(1.5) == 1.5
    assert cli._finite("m") == "m"
