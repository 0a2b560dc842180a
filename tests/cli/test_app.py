"""The command line as a whole: help, refusals, exit codes, streams and encodings."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
from asking import ask, process, refused

from lab.base.plain_data import to_plain_data
from lab.cli.app import COMMANDS


def test_alone_it_prints_help_with_every_command_and_examples() -> None:
    answer = ask()
    assert answer.exit_code == 0
    for word in ("missions", "run", "fly", "serve", "--version", "Examples:", "ins-lab run montreal"):
        assert word in answer.stdout


@pytest.mark.parametrize(
    "command",
    [
        "missions",
        "run",
        "figure",
        "ensemble",
        "sweep",
        "fly",
        "profile",
        "cards",
        "allan",
        "outage",
        "budget",
        "numbers",
        "receiver",
        "calibrate",
        "scoreboard",
        "live",
        "lesson",
        "homework",
        "grade",
        "notebooks",
        "serve",
    ],
)
def test_every_command_has_help(command: str) -> None:
    answer = ask(command, "--help")
    assert answer.exit_code == 0
    assert answer.stdout.startswith(f"Usage: ins-lab {command}")


def test_the_version_is_the_one_installed() -> None:
    assert ask("--version").stdout.startswith("ins-lab 0.")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["sail"],
            [
                "no command 'sail'",
                "missions, run, report, figure, compare, ensemble, sweep, outage, budget, identify, numbers",
                "receiver, calibrate, judge, scoreboard, fly",
                "cards",
                "allan",
                "serve",
            ],
        ),
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
        (["run", "montreal", "--out", "run.json"], ["ending in .nc", "--json prints JSON", "> FILE.json"]),
        (["run", "montreal", "--json", "run.json"], ["unexpected extra argument", "(run.json)"]),
        (["run", "montreal", "--json=run.json"], ["--json", "does not take a value"]),
        (["run", "montreal", "--json", "--with", "budgets"], ["budgets", "budget and identification"]),
        (["run", "montreal", "--with", "budget"], ["needs --json", "ins-lab budget"]),
        (["report", "montreal", "--json"], ["Missing option '--to'"]),
        (["report", "montreal", "--json", "--to", "a.json"], ["ending in .html", "--json prints JSON"]),
        (["compare", "montrael"], ["Did you mean montreal?"]),
        (["compare", "montreal", "--models", "phi,psy"], ["navigator.model", "'psy'", "one of phi"]),
        (["compare", "montreal", "--models", ""], ["navigator.model", "one of phi"]),
        (["compare", "montreal", "--seeds", "0"], ["--seeds"]),
        (["compare", "los_angeles", "--seeds", "9" * 20], ["--seeds", "less than or equal to"]),
        (["compare", "montreal", "--seeds", "x"], ["--seeds", "integer"]),
        (["compare", "montreal", "--set", "navigator.r=[1, 1, 1, 0, 1, 1]"], ["navigator.r", "singular"]),
        (["fly", "montrael"], ["Did you mean montreal?"]),
        (["run", "montreal", "--card", "ADIS1647"], ["Did you mean ADIS16470?", "STIM300"]),
        (["run", "montreal", "--card", "nowhere.toml"], ["nowhere.toml", "cannot be read"]),
        (["cards", "ADIS1647"], ["Did you mean ADIS16470?", "STIM300"]),
        (["cards", "nowhere.toml", "--json"], ["nowhere.toml", "cannot be read"]),
        (["allan"], ["Missing argument 'FILE'"]),
        (["allan", "nowhere.csv"], ["nowhere.csv", "no such file"]),
        (["allan", "ADIS1647"], ["Did you mean ADIS16470?", "or a file with a log"]),
        (["allan", "nowhere.toml"], ["nowhere.toml", "cannot be read"]),
        (["allan", "STIM300", "--card", "mine.toml"], ["a card is made from a log, and STIM300 is not one"]),
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
    refused(ask(*arguments), *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[sensors.gyro]\nnoise = 1\n", ["sensors.gyro.noise", "Did you mean"]),
        ("[sensors.gps]\nperiod = 0\n", ["sensors.gps.period = 0", "from 0.05 to 60 s"]),
        ("sensors = 3\n", ["is a group of settings"]),
        ("a = \n", ["TOML", "line 1"]),
        ("\udcff", ["TOML"]),
        ("a = " + "[" * 5000, ["brackets inside one another"]),
    ],
)
def test_a_bad_file_of_settings_is_named(tmp_path: Path, text: str, words: list[str]) -> None:
    config = tmp_path / "settings.toml"
    config.write_bytes(text.encode("utf-8", "surrogateescape"))
    refused(ask("run", "montreal", "--config", str(config)), "settings.toml", *words)


@pytest.mark.proof
def test_json_is_all_there_is_on_standard_output() -> None:
    done = process("run", "los_angeles", "--json")
    assert done.returncode == 0, done.stderr.decode()
    assert json.loads(done.stdout)["mission"] == "los_angeles"


def test_refusals_of_a_process_are_on_standard_error_with_code_2() -> None:
    done = process("run", "montreal", "--set", "sensors.gyro.noise_density=99")
    assert done.returncode == 2
    assert done.stdout == b""
    assert b"Traceback" not in done.stderr


@pytest.mark.proof
@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1"])
def test_units_do_not_break_a_terminal_that_lacks_their_signs(encoding: str) -> None:
    done = process("run", "montreal", "--set", "sensors.gyro.noise_density=99", PYTHONIOENCODING=encoding)
    assert done.returncode == 2
    assert "/s/sqrtHz" in done.stderr.decode(encoding)
    assert process("missions", PYTHONIOENCODING=encoding).returncode == 0


def test_a_reader_that_leaves_early_is_no_error() -> None:
    command = [sys.executable, "-c", "from dashboards.command_line import main; main()", "missions"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert b"Traceback" not in process.stderr.read()


def test_numbers_json_does_not_know_are_null() -> None:
    assert to_plain_data(math.nan) is None
    assert to_plain_data(1.5) == 1.5
    assert to_plain_data("m") == "m"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
@pytest.mark.parametrize("command", [["missions"], ["--version"]])
def test_output_to_a_full_disk_is_reported(command: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        answer = subprocess.run(
            [sys.executable, "-m", "dashboards", *command],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert answer.returncode == 2
    assert answer.stderr == "ins-lab: standard output: No space left on device\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_the_summary_of_a_command_is_that_of_its_own_help(name: str) -> None:
    summary = COMMANDS[name][1]
    own = ask(name, "--help")
    assert own.exit_code == 0
    assert summary in " ".join(own.stdout.split())


@pytest.mark.parametrize("group", ["live", "lesson", "homework", "notebooks"])
def test_a_group_of_commands_does_not_install_completion(group: str) -> None:
    assert "--install-completion" not in ask(group, "--help").stdout


def test_help_imports_no_command_and_no_numbers() -> None:
    code = "\n".join(
        (
            "import sys",
            "from dashboards.command_line import main",
            "try: main()",
            "except SystemExit: print(*sys.modules)",
        )
    )
    answer = subprocess.run(
        [sys.executable, "-c", code, "--help"], capture_output=True, text=True, check=True
    )
    loaded = answer.stdout.splitlines()[-1].split()
    assert "lab.cli.app" in loaded
    assert not {"numpy", "param", "numba", "pandas", "lab.cli.run", "dashboards.serve_command"} & set(loaded)


@pytest.mark.parametrize("name", ["typing", "lab", "lab.cli.app", "typer"])
def test_ctrl_c_while_it_starts_ends_it_without_a_traceback(name: str) -> None:
    """The key is pressed while a module is imported."""
    program = (
        "import sys\n"
        "class Pressed:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {name!r}: raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Pressed())\n"
        "import dashboards.command_line\n"
    )
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (answer.returncode, answer.stdout, answer.stderr) == (130, "", "")
