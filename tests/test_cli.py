"""The command line: what it answers, where, and with which exit code, to right and wrong arguments."""

from __future__ import annotations

import io
import json
import math
import os
import re
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

import numpy as np
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


@pytest.mark.parametrize("command", ["missions", "run", "fly", "cards", "allan", "budget", "serve"])
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
    table_of_errors, _, verdict = answer.stdout.partition("\n\n")
    assert verdict.startswith("Verdict (1 run, errors and innovations): Consistent")
    header, *rows = table_of_errors.splitlines()
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


def test_a_run_says_what_is_wrong_with_its_filter_and_what_to_try() -> None:
    arguments = ("run", "los_angeles", "--set", "navigator.p0_scale=0.1", "--set", "navigator.q_scale=0.1")
    text = _ask(*arguments).stdout.partition("\n\n")[2]
    assert re.search(r"Q about (9\.\d|10|11) × too small\. \(1 more\)", text)
    assert "P₀ about" in text
    assert text.count("Try: Multiply") == 2
    verdict = json.loads(_ask(*arguments, "--json").stdout)["verdict"]
    assert verdict["consistent"] is False
    assert [finding["quantity"] for finding in verdict["findings"]] == ["Q", "P0"]
    assert verdict["headline"] in text


def test_models_are_compared_on_the_same_flights() -> None:
    arguments = ("compare", "los_angeles", "--models", "phi", "--seeds", "2", "--seed", "5")
    header, row = _ask(*arguments).stdout.splitlines()
    assert header.split()[0] == "model"
    assert header.split()[-1] == "verdict"
    assert row.startswith("phi")
    assert "/ 15" in row
    assert "Consistent" in row
    (phi,) = json.loads(_ask(*arguments, "--json").stdout)
    assert phi["model"] == "phi"
    assert f"{phi['position']:.3f}" in row
    assert phi["refusal"] == ""


def test_all_models_are_compared_where_none_is_named() -> None:
    from lab.comparison import models

    answer = _ask("compare", "los_angeles", "--json")
    assert [row["model"] for row in json.loads(answer.stdout)] == list(models())


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


def test_cards_are_a_table_from_consumer_to_navigation_grade() -> None:
    from lab import cards

    header, *rows = _ask("cards").stdout.splitlines()
    assert header.split()[:2] == ["name", "grade"]
    assert [row.split("  ")[0] for row in rows] == list(cards())
    stim300 = next(row for row in rows if row.startswith("STIM300"))
    assert stim300.split()[1:] == ["tactical", "0.0025", "0.5", "119", "0.05"]


def test_cards_as_json_hold_sources_settings_and_what_is_missing() -> None:
    entries = {entry["name"]: entry for entry in json.loads(_ask("cards", "--json").stdout)}
    stim300 = entries["STIM300"]
    assert stim300 == json.loads(_ask("cards", "stim300", "--json").stdout)
    assert stim300["gyro"]["noise_density"]["value"] == 0.15
    assert "TS1524" in stim300["sources"][stim300["gyro"]["noise_density"]["source"]]
    assert stim300["settings"]["gyro"]["noise_density"] == 0.0025
    assert "Bandwidth" in stim300["missing"]["gyro"]


def test_one_card_is_shown_with_sources_and_what_is_missing() -> None:
    answer = _ask("cards", "HG9900").stdout
    assert answer.startswith("HG9900: Honeywell, navigation grade")
    assert "0.002  °/√h" in answer
    assert "brochure N61-1638-000-000" in answer
    assert "No source, off when loaded: accelerometer: White noise" in answer


def test_a_run_takes_the_sensors_of_a_card_then_those_of_set() -> None:
    flags = ["--card", "STIM300", "--set", "sensors.gyro.flicker=3", "--json"]
    sensors = json.loads(_ask("run", "los_angeles", *flags).stdout)["settings"]["sensors"]
    assert sensors["gyro"]["noise_density"] == [0.0025] * 3
    assert sensors["gyro"]["flicker"] == [3.0] * 3
    assert sensors["gyro"]["range"] > 150  # of which the card has no source: off


def _log(path: Path) -> Path:
    rng = np.random.default_rng(3)
    columns = np.column_stack(
        (
            0.01 * np.arange(5000),
            np.radians(0.1) * rng.standard_normal((5000, 3)),
            0.01 * rng.standard_normal((5000, 3)) - (0, 0, 9.8),
        )
    )
    header = "t_s,gx_rad_s,gy_rad_s,gz_rad_s,fx_m_s2,fy_m_s2,fz_m_s2"
    np.savetxt(path, columns, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def test_a_log_at_rest_becomes_a_table_and_a_card_that_runs(tmp_path: Path) -> None:
    log, out = _log(tmp_path / "imu.csv"), tmp_path / "mine.toml"
    answer = _ask("allan", str(log), "--card", str(out))
    assert answer.exit_code == 0, answer.stderr
    header, *rows = answer.stdout.splitlines()
    assert header.split() == ["group", "axis", "term", "fitted", "σ", "unit"]
    white = [row for row in rows if "White noise" in row]
    assert [row.split()[:2] for row in white] == [
        [triad, axis] for triad in ("gyro", "accelerometer") for axis in "xyz"
    ]
    assert all(float(row.split()[4]) == pytest.approx(0.01, rel=0.05) for row in white[:3])
    _refused(_ask("allan", str(log), "--card", str(out)), "exists already", "--force")
    assert _ask("allan", str(log), "--card", str(out), "--force").exit_code == 0
    assert _ask("cards", str(out)).stdout.startswith("mine: own grade")
    assert _ask("run", "los_angeles", "--card", str(out)).exit_code == 0


def test_an_allan_deviation_as_json_holds_the_curve(tmp_path: Path) -> None:
    answer = json.loads(_ask("allan", str(_log(tmp_path / "imu.csv")), "--json").stdout)
    gyro = answer["gyro"]
    assert gyro["dt_s"] == pytest.approx(0.01)
    assert gyro["unit"] == "rad/s"
    curve = np.array(gyro["deviation"])
    assert curve.shape == (len(gyro["tau_s"]), 3)
    assert (np.array(gyro["low"]) < curve).all()
    assert (curve < np.array(gyro["high"])).all()
    assert curve[0] == pytest.approx(np.radians(0.1), rel=0.05)
    assert gyro["terms"]["noise_density"]["unit"] == "°/s/√Hz"


def test_a_card_simulated_at_rest_stands_beside_its_own_values() -> None:
    answer = _ask("allan", "STIM300", "--seed", "2")
    header, *rows = answer.stdout.splitlines()
    assert header.split()[-1] == "card"
    for row in rows:
        if "White noise" in row:
            fitted, _, _, own = row.split()[4:]
            assert float(fitted) == pytest.approx(float(own), rel=0.05)
    assert _ask("allan", "STIM300", "--seed", "3").stdout != answer.stdout
    assert _ask("allan", "STIM300", "--seed", "2").stdout == answer.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["sail"], ["no command 'sail'", "missions, run, compare, budget, fly", "cards", "allan", "serve"]),
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
        (["compare", "montrael"], ["Did you mean montreal?"]),
        (["compare", "montreal", "--models", "phi,psy"], ["navigator.model", "'psy'", "one of phi"]),
        (["compare", "montreal", "--models", ""], ["navigator.model", "one of phi"]),
        (["compare", "montreal", "--seeds", "0"], ["--seeds"]),
        (["compare", "montreal", "--seeds", "x"], ["--seeds", "integer"]),
        (["compare", "montreal", "--set", "navigator.r=[1, 1, 1, 0, 1, 1]"], ["navigator.r", "singular"]),
        (["fly", "montrael"], ["Did you mean montreal?"]),
        (["run", "montreal", "--card", "ADIS1647"], ["Did you mean ADIS16470?", "STIM300"]),
        (["run", "montreal", "--card", "nowhere.toml"], ["nowhere.toml", "cannot be read"]),
        (["cards", "ADIS1647"], ["Did you mean ADIS16470?", "STIM300"]),
        (["cards", "nowhere.toml", "--json"], ["nowhere.toml", "cannot be read"]),
        (["allan"], ["FILE.csv"]),
        (["allan", "nowhere.csv"], ["nowhere.csv", "no such file"]),
        (["allan", "ADIS1647"], ["Did you mean ADIS16470?", "of a log, ending in .csv"]),
        (["allan", "nowhere.toml"], ["nowhere.toml", "cannot be read"]),
        (["allan", "STIM300", "--card", "mine.toml"], ["a card is made of a log, not of STIM300"]),
        (["allan", "imu.csv", "--card", "mine.csv"], ["--card mine.csv", "ending in .toml"]),
        (["allan", "imu.csv", "--card", "nowhere/mine.toml"], ["no folder nowhere"]),
        (["allan", "STIM300", "--seed", "-1"], ["--seed", "greater than or equal to 0"]),
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


def test_a_budget_is_a_table_that_sums_to_its_total() -> None:
    answer = _ask("budget", "los_angeles", "--set", "sensors.gps.period=2", "--at", "60")
    assert answer.exit_code == 0, answer.stderr
    header, *rows = answer.stdout.splitlines()
    assert header.split()[:3] == ["source", "position", "[m]"]
    assert rows[-1].startswith("total")
    columns = [[float(cell) for cell in row.split()[-6:]] for row in rows]
    for metres, percent in ((0, 1), (2, 3), (4, 5)):
        assert sum(row[metres] ** 2 for row in columns[:-1]) == pytest.approx(
            columns[-1][metres] ** 2, rel=0.02
        )
        assert sum(row[percent] for row in columns[:-1]) == pytest.approx(100, abs=1)
    assert [sum(row[1::2]) for row in columns[:-1]] == sorted(
        (sum(row[1::2]) for row in columns[:-1]), reverse=True
    )


def test_a_budget_as_json_has_every_component_and_what_the_filter_believes() -> None:
    answer = json.loads(_ask("budget", "los_angeles", "--set", "navigator.r_scale=100", "--json").stdout)
    quantities = {row["quantity"]: row for row in answer["quantities"]}
    assert answer["mission"] == "los_angeles"
    east = quantities["position east"]
    assert east["unit"] == "m"
    assert east["believed"] > 1.5 * east["total"]
    assert sum(source["percent"] for source in east["sources"]) == pytest.approx(100)


def test_a_budget_names_what_it_leaves_out() -> None:
    answer = _ask("budget", "los_angeles", "--set", "sensors.gyro.quantisation=0.1")
    assert "Not in the budget: sensors.gyro.quantisation" in answer.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--at", "1000"], ["--at 1000", "from 0 to 105"]),
        (["--at", "-1"], ["--at -1", "from 0 to 105"]),
        (["--set", "navigator.model=nonlinear"], ["linear model", "phi"]),
        (["--set", "navigator.modell=phi"], ["there is no setting"]),
    ],
)
def test_a_budget_that_cannot_be_made_says_why(arguments: list[str], words: list[str]) -> None:
    _refused(_ask("budget", "los_angeles", *arguments), *words)
