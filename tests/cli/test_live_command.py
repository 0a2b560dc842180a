"""``ins-lab live``: a simulated device and what reads it, each a process or a command of its own."""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asking import ask, refused
from live_streams import fixes, motion
from text_outputs import still_dot
from writers.nmea import sentence

from lab.cli import live as live_command
from lab.cli.beside_lines import BesideLines
from lab.data.protocols.vectornav import VectorNavEncoder
from lab.data.streams import recorded_log
from lab.data.streams.recorded_log import recorded_samples
from lab.live.simulated.simulated_device import SimulatedDevice
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.missions import mission


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_the_list_names_protocols_and_sources() -> None:
    answer = ask("live", "list")
    assert answer.exit_code == 0
    for word in ("vectornav", "mavlink", "serial:PORT?baud=115200", "simulated:MISSION"):
        assert word in answer.stdout
    found = json.loads(ask("live", "list", "--json").stdout)
    assert set(found) == {"ports", "problem", "protocols", "simulated devices", "sources"}


@pytest.mark.proof
def test_a_simulated_device_in_another_process_is_watched() -> None:
    port = free_port()
    simulate = [sys.executable, "-m", "dashboards", "live", "simulate", "montreal", "--rate", "100"]
    with subprocess.Popen(
        [*simulate, "--device", "xsens", "--to", f"tcp:{port}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
    ) as device:
        assert device.stdout is not None
        assert f"ins-lab live watch tcp:127.0.0.1:{port}" in device.stdout.readline()
        answer = ask("live", "watch", f"tcp:127.0.0.1:{port}", "--seconds", "12", "--json")
        device.send_signal(signal.SIGINT)
        rest = device.stdout.read()
    assert device.returncode == 0
    assert re.search(r"\d+ samples sent", rest)
    assert answer.exit_code == 0, answer.output
    last = json.loads(answer.stdout.splitlines()[-1])
    assert last["protocol"] == "xsens"
    assert last["samples"] > 100
    assert abs(last["force_m_s2"][2] + 9.8) < 1
    assert "nothing was lost" in answer.stderr


@pytest.mark.proof
def test_what_is_recorded_becomes_a_mission_and_plays_again(tmp_path: Path) -> None:
    folder = str(tmp_path)
    answer = ask("live", "record", "simulated:montreal?hz=50", "drive", "--seconds", "9", "--out", folder)
    assert answer.exit_code == 0, answer.output
    raw = tmp_path / "drive.inslab"
    log = mission(str(tmp_path / "drive")).log  # type: ignore[attr-defined]
    assert log.duration > 7
    assert len(log.gnss.time) >= 6
    assert log.dtheta.shape[0] == len(recorded_samples(raw).imu) - 1
    again = ask("live", "watch", f"replay:{raw}?speed=max")
    assert again.exit_code == 0
    assert "The recording has ended." in again.stderr
    cut = tmp_path / "cut.inslab"
    cut.write_bytes(raw.read_bytes()[:-3])
    again = ask("live", "watch", f"replay:{cut}?speed=max")
    assert "The recording has ended: it was cut off within a record" in again.stderr
    refused(ask("live", "record", "simulated:montreal", "drive", "--out", folder), "drive exists")
    raw_alone = ask("live", "record", f"replay:{raw}?speed=max", "twice", "--out", folder)
    assert raw_alone.exit_code == 0, raw_alone.output
    assert len(recorded_samples(tmp_path / "twice.inslab").imu) == len(recorded_samples(raw).imu)


FILTERS = """
class Still:
    def step(self, imu, fixes):
        print("printed by the algorithm")
        return [1.0, 0.0, 0.0, 0.0]


class Raises:
    def step(self, imu, fixes):
        raise ValueError("no idea")
"""


def test_filters_of_the_user_run_beside_the_navigator(tmp_path: Path) -> None:
    """The device on the table stands at roll 2°, pitch -3°; what a filter prints is in no object."""
    path = tmp_path / "mine.py"
    path.write_text(FILTERS, encoding="utf-8")
    given = ("--algorithm", f"{path}:Still", "--algorithm", f"{path}:Raises")
    one = ("live", "navigate", "simulated:rest?device=vectornav", "--seconds", "4")
    answer = ask(*one, *given, "--json")
    assert answer.exit_code == 0, answer.output
    last = [json.loads(line) for line in answer.stdout.splitlines()][-1]
    assert last["euler_beside"]["Still"] == [0.0, 0.0, 0.0]
    assert np.degrees(last["euler_beside"]["truth"])[:2] == pytest.approx([2.0, -3.0], abs=1e-6)
    assert "mine.py, line 10, in step: ValueError: no idea" in last["algorithms"]["Raises"]
    refused(ask(*one, "--algorithm", f"{path}:No"), "has no 'No'; live algorithms in the file: Raises, Still")
    refused(ask(*one, *given, "--algorithm", f"{path}:Still"), "different names")


def test_the_time_of_a_filter_to_load_is_none_of_the_seconds_that_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Filters of the user start in processes of their own, which may take long on a busy computer."""

    class Slow(BesideLines):
        def __init__(self, *given: Any) -> None:
            time.sleep(2.0)
            super().__init__(*given)

    monkeypatch.setattr("lab.cli.beside_lines.BesideLines", Slow)
    answer = ask("live", "navigate", "simulated:rest?device=vectornav", "--seconds", "1.5", "--json")
    assert len(answer.stdout.splitlines()) > 1  # one a second, and the last


@pytest.mark.proof
def test_attitudes_beside_the_navigator_are_printed_and_compared(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(FILTERS, encoding="utf-8")
    given = ("--algorithm", f"{path}:Still", "--algorithm", f"{path}:Raises")
    answer = ask("live", "navigate", "simulated:rest?device=vectornav", "--seconds", "4", *given)
    assert re.search(r"0\.00 +0\.00 +0\.00  Still", answer.stdout)
    # Filters that loaded for long follow what came meanwhile, too.
    assert re.search(r"Still - truth +\d+\.\d +3\.6\d +2\.00 +3\.00", answer.stdout)
    assert "Raises: raised an exception" in answer.stdout


@pytest.mark.proof
def test_a_recording_is_navigated_with(tmp_path: Path) -> None:
    folder = str(tmp_path)
    source = "simulated:montreal?hz=50&rest=12"
    assert ask("live", "record", source, "still", "--seconds", "14", "--out", folder).exit_code == 0
    replay = f"replay:{tmp_path}/still.inslab?speed=10"
    answer = ask("live", "navigate", replay, "--set", "navigator.initial_heading=-137.5", "--json")
    assert answer.exit_code == 0, answer.output
    last = [json.loads(line) for line in answer.stdout.splitlines()][-1]
    assert last["phase"] == "navigating"
    assert abs(last["pitch_deg"] - 2.45) < 1  # that at the start of the flight
    assert last["north_sigma_m"] < 5
    refused(ask("live", "navigate", replay, "--card", "nothing"), "nothing")
    refused(ask("live", "navigate", replay, "--set", "navigator.model=nonlinear"), "nonlinear")


@pytest.mark.proof
def test_without_fixes_the_bytes_stay_and_the_lack_is_said(tmp_path: Path) -> None:
    answer = ask(
        "live",
        "record",
        "simulated:montreal?hz=50&device=text",
        "bare",
        "--seconds",
        "3",
        "--out",
        str(tmp_path),
    )
    assert answer.exit_code == 0, answer.output
    assert "No mission: the source sent no fixes" in answer.stdout
    assert (tmp_path / "bare.inslab").is_file()
    assert not (tmp_path / "bare").exists()


def test_a_receiver_that_estimates_is_refused_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "tunnel.nmea"
    place = "4807.038,N,01131.000,E,6,00,0.9,545.4,M,46.9,M,,"
    path.write_text("".join(sentence(f"GPGGA,1200{second:02d}.00,{place}") for second in range(20)), "ascii")
    answer = ask("live", "watch", f"replay:{path}?speed=max")
    assert answer.exit_code == 2
    assert "20 of 20 positions are not used: the receiver estimated the position" in answer.stderr


def test_a_source_that_sends_nothing_is_refused_and_its_name_stays_free(tmp_path: Path) -> None:
    nobody = f"tcp:127.0.0.1:{free_port()}"
    words = "no sample came, and no byte. "
    for command in ("watch", "navigate"):
        answer = ask("live", command, nobody, "--seconds", "0.5")
        assert answer.exit_code == 2
        assert words in answer.stderr
    for folder in (tmp_path, tmp_path / "new" / "drives"):
        refused(ask("live", "record", nobody, "drive", "--seconds", "0.5", "--out", str(folder)), words)
    assert not list(tmp_path.iterdir())


@pytest.mark.proof
def test_a_second_interrupt_tells_how_the_recording_becomes_a_mission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first ends the recording; the second one ends what makes the mission."""

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    arguments = ("live", "record", "simulated:montreal?hz=50", "drive", "--seconds", "9", "--out")
    with monkeypatch.context() as patched:
        patched.setattr(recorded_log, "log_of_recording", interrupted)
        answer = ask(*arguments, str(tmp_path))
    assert answer.exit_code == 130
    assert [path.name for path in tmp_path.iterdir()] == ["drive.inslab"]
    found = re.search(r'No mission was made.*ins-lab live record "(replay:.*speed=max)" NAME', answer.stderr)
    assert found is not None
    answer = ask("live", "record", found[1], "again", "--out", str(tmp_path))
    assert answer.exit_code == 0, answer.output
    assert mission(str(tmp_path / "again")).log.duration > 6  # type: ignore[attr-defined]


def test_bytes_of_another_speed_are_refused_and_stay(tmp_path: Path) -> None:
    noise = bytes(random.Random(1).randrange(256) for _ in range(6000))
    with socket.create_server(("127.0.0.1", 0)) as server:

        def send() -> None:
            client, _ = server.accept()
            client.sendall(noise)
            ended.wait()
            client.close()

        ended = threading.Event()
        thread = threading.Thread(target=send)
        thread.start()
        source = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        answer = ask("live", "record", source, "drive", "--seconds", "2", "--out", str(tmp_path))
        ended.set()
        thread.join()
    refused(answer, "no sample came, only", " bytes. ")
    assert (tmp_path / "drive.inslab").stat().st_size > 6000


def test_an_unplugged_device_is_a_loss() -> None:
    data = VectorNavEncoder().encode(motion(200), fixes(2))
    with socket.create_server(("127.0.0.1", 0)) as server:

        def send() -> None:
            client, _ = server.accept()
            with client:
                client.sendall(data)
            server.close()  # it does not come back

        thread = threading.Thread(target=send)
        thread.start()
        answer = ask("live", "watch", f"tcp:127.0.0.1:{server.getsockname()[1]}", "--seconds", "1", "--json")
        thread.join()
    assert answer.exit_code == 0, answer.output
    assert json.loads(answer.stdout.splitlines()[-1])["samples"] == 200
    assert "1 interruption of the connection" in answer.stderr
    assert "nothing was lost" not in answer.stderr


def test_a_device_on_a_table_stands_until_it_is_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[bool] = []
    device = SimulatedDevice.__init__

    def noted(*arguments: object, endless: bool = False, **more: object) -> None:
        made.append(endless)
        device(*arguments, endless=endless, **more)  # type: ignore[arg-type]

    class Pressed:
        def wait(self, _seconds: float) -> bool:
            return True

    monkeypatch.setattr(SimulatedDevice, "__init__", noted)
    monkeypatch.setattr(live_command, "interrupted", lambda: contextlib.nullcontext(Pressed()))
    answer = ask("live", "simulate", "rest", "--to", f"tcp:{free_port()}")
    assert "Sending until Ctrl-C" in answer.stdout, answer.output
    answer = ask("live", "simulate", "rest", "--rest", "5", "--to", f"tcp:{free_port()}")
    assert "Sending 500 samples" in answer.stdout, answer.output
    assert made == [True, False]
    monkeypatch.setattr(SimulatedFlight, "of", lambda *_, **__: pytest.fail("it has flown"))
    refused(ask("live", "simulate", "rest", "--device", "toaster"), "'toaster' is no device", "vectornav")


def test_a_unit_that_nothing_names_is_a_question_on_standard_error(tmp_path: Path) -> None:
    path = tmp_path / "dot.csv"
    path.write_text(still_dot(600))
    source = f"replay:{path}?speed=max"
    answer = ask("live", "watch", source)
    assert "°/s is used, and rad/s is possible. --unit rate=rad/s says so" in answer.stderr
    assert "rate_x[°/s]" in answer.stderr
    answer = ask("live", "watch", source, "--unit", "rate=rad/s")
    assert "is not known" not in answer.stderr
    assert "rate_x[rad/s]" in answer.stderr
    states = map(json.loads, ask("live", "watch", f"replay:{path}?speed=10", "--json").stdout.splitlines())
    assert any("rad/s is possible" in state["question"] for state in states)
    refused(ask("allan", str(path)), "--unit Gyr_X=°/s")


def test_a_unit_for_a_stream_that_is_no_text_is_reported() -> None:
    answer = ask("live", "watch", "simulated:rest?hz=50", "--seconds", "2", "--unit", "rate=rad/s")
    assert answer.exit_code == 0, answer.output
    assert "--unit had no effect: units are of text lines, and the source sends vectornav" in answer.stderr


def test_text_without_times_is_timed_by_the_rate_that_is_given(tmp_path: Path) -> None:
    path = tmp_path / "bare.csv"
    rng = np.random.default_rng(1)
    rows = rng.normal((0, 0, 9.8, 0, 0, 0), (0.01, 0.01, 0.01, 0.1, 0.1, 0.1), (3000, 6))
    np.savetxt(path, rows, "%.4f", ",", header="ax,ay,az,gx,gy,gz", comments="")
    source = f"replay:{path}?speed=max"
    assert "nothing in it has a time, so that its samples cannot be timed; with --rate 100" in (
        ask("live", "watch", source).stderr
    )
    answer = ask("live", "watch", source, "--rate", "60")
    assert "Timed by the number of samples at 60 Hz, given." in answer.stderr
    refused(ask("allan", str(path), "--unit", "rate=deg/s"), "--rate 100")
    answer = ask("allan", str(path), "--unit", "rate=deg/s", "--rate", "60", "--json")
    assert answer.exit_code == 0, answer.output
    assert json.loads(answer.stdout)["gyro"]["dt_s"] == pytest.approx(1 / 60)
    refused(ask("allan", "ADIS16470", "--rate", "60"), "are for logs")


def test_what_navigates_sends_its_solution_and_counts_what_was_lost(tmp_path: Path) -> None:
    path, out = tmp_path / "raw.bin", tmp_path / "out.mcap"
    path.write_bytes(VectorNavEncoder().encode(motion(400), fixes(0)))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reader:
        reader.bind(("127.0.0.1", 0))
        reader.settimeout(60)
        port = reader.getsockname()[1]
        answer = ask(
            "live", "navigate", f"replay:{path}", "--to", f"udp:127.0.0.1:{port}", "--hz", "50",
            "--to", f"mcap:{out}", "--to", "tcp:0.0.0.0:0?protocol=nmea", "--json",
        )  # fmt: skip
        assert answer.exit_code == 0, answer.output
        row = json.loads(reader.recv(65536))
    printed = json.loads(answer.stdout.splitlines()[-1])
    assert printed.keys() - row.keys() == {"reason", "heading_source"}
    assert row.keys() <= printed.keys()
    assert f"sends json at 50 Hz: datagrams to 127.0.0.1, port {port}" in answer.stderr
    assert "sends nmea at 50 Hz: tcp://0.0.0.0:" in answer.stderr
    assert "other computers can connect" in answer.stderr
    sent = re.search(r"out\.mcap: (\d+) rows sent, (\d+) lost", answer.stderr)
    assert sent is not None
    assert int(sent[1]) + int(sent[2]) > 20  # of 200; those that a busy computer sends
    assert out.read_bytes().endswith(b"MCAP0\r\n")
    refused(ask("live", "navigate", f"replay:{path}", "--to", f"mcap:{out}"), f"--to mcap:{out}", "exists")


def test_columns_that_are_not_recognised_are_shown_and_named_by_number(tmp_path: Path) -> None:
    path = tmp_path / "odd.txt"
    path.write_text("".join(f"D 2.{k % 7} 2.{k % 5} 3.{k % 3} 1.{k % 2} 2.{k % 9} 1.5\n" for k in range(600)))
    source = f"replay:{path}?speed=max&rate=60"
    refused(
        ask("live", "watch", source),
        "D 2.4 2.4 3.2 1.1 2.5 1.5",
        "They have 6 columns, 2.4, 2.4",
        "--column '1=",
    )
    names = [
        f"{vector}_{axis}[{unit}]"
        for vector, unit in (("force", "m/s²"), ("rate", "deg/s/131"))
        for axis in "xyz"
    ]
    said = [word for number, name in enumerate(names, 1) for word in ("--column", f"{number}={name}")]
    answer = ask("live", "watch", source, *said)
    assert answer.exit_code == 0, answer.output
    assert "600 samples" in answer.stderr
    assert "rate_x[°/s/131]" in answer.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["watch", "udp:5555", "--unit", "rate=lb"], ["'lb' is no unit of it", "°/s, rad/s"]),
        (["watch", "udp:5555", "--unit", "rate"], ["--unit rate", "QUANTITY=UNIT, such as rate=deg/s"]),
        (["watch", "udp:5555", "--rate", "0"], ["--rate 0", "0.1 to 10000 Hz"]),
        (["watch", "udp:5555?rate=x"], ["rate = 'x'", "0.1 to 10000 Hz"]),
        (["navigate", "udp:5555", "--to", "nowhere"], ["--to 'nowhere'", "udp:COMPUTER:PORT"]),
        (["navigate", "udp:5555", "--to", "tcp:5556", "--hz", "900"], ["--hz 900", "0.1 to 200 Hz"]),
        (["navigate", "udp:5555", "--hz", "50"], ["--hz: needs --to"]),
        (["navigate", "udp:5555?to=tcp:1"], ["'to' is no option of a udp source"]),
        (["navigate", "udp:5555", "--to", "tcp:1?protocol=ubx"], ["'ubx'", "json, nmea, mavlink"]),
        (["navigate", "udp:5555", "--to", "mcap:nowhere/a.mcap"], ["--to mcap:nowhere/a.mcap"]),
        (["navigate", "udp:5555", "--to", "udp:no.such.invalid:9"], ["no computer with this name"]),
        (["watch", "udp:5555", "--column", "1=moon[m/s]"], ["'moon' is no quantity"]),
        (["watch", "udp:5555?protocol=mip", "--unit", "rate=deg/s"], ["columns are of text lines"]),
        (["watch"], ["SOURCE"]),
        (["watch", "COM3"], ["'COM3' names no source", "serial:PORT"]),
        (["watch", "replay:nowhere.inslab"], ["nowhere.inslab", "cannot be read"]),
        (["watch", "simulated:montrael"], ["Did you mean montreal?"]),
        (["watch", "simulated:montreal?card=nothing"], ["nothing"]),
        (["watch", "udp:5555?protocol=nmae"], ["'nmae' is no protocol"]),
        (["watch", "udp:5555", "--seconds", "0"], ["--seconds 0", "more than 0"]),
        (["record", "udp:5555", "../drive"], ["../drive"]),
        (["record", "udp:5555", "drive", "--lever-arm", "1,2"], ["--lever-arm 1,2", "three numbers"]),
        (["record", "udp:5555", "drive", "--lever-arm", "1,2,900"], ["up to 100 m"]),
        (["simulate", "montreal", "--to", "nowhere"], ["'nowhere' is no place", "pty, tcp:5555"]),
        (["simulate", "montreal", "--rate", "0"], ["--rate 0", "1 to 2000 Hz"]),
        (["simulate", "montreal", "--corruption", "2"], ["--corruption 2", "0 to 0.1"]),
        (["simulate", "pacific", "--rest", "10"], ["begins at 83 m/s"]),
        (["simulate", "montreal", "--axes", "x,y,-z"], ["mirror image"]),
        (["simulate", "montreal", "--set", "sensors.heading.fited=true"], ["fited", "fitted"]),
        (["sail"], ["no command 'sail'", "list, watch, record, navigate, simulate"]),
    ],
)
def test_mistakes_are_answered_with_what_is_accepted(arguments: list[str], words: list[str]) -> None:
    refused(ask("live", *arguments), *words)


@pytest.mark.proof
def test_a_device_that_sends_no_readings_says_so_and_who_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimulatedDevice, "finished", True)  # it need not fly
    fitted = ("--set", "sensors.heading.fitted=true", "--set", "sensors.odometer.fitted=true")

    def told(device: str) -> str:
        answer = ask(
            "live", "simulate", "montreal", "--device", device, "--to", f"tcp:{free_port()}", *fitted
        )
        assert answer.exit_code == 0, answer.output
        return answer.stderr

    both = "sends no headings; accepted for them are vectornav, xsens, mip, ublox, nmea"
    for device in ("memsense", "text", "phone"):
        said = told(device)
        assert f"--device {device}: This device {both}" in said
        assert "sends no speeds; accepted for them are ublox" in said
    said = told("vectornav")
    assert "headings" not in said
    assert "sends no speeds" in said
    assert told("ublox") == ""


def test_a_device_that_cannot_send_says_where_and_why() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        to = f"tcp:{taken.getsockname()[1]}"
        refused(
            ask("live", "simulate", "rest", "--to", to), f"--to {to}: another program listens on this port"
        )
    nobody = "udp:nobody.invalid:5555"
    refused(ask("live", "simulate", "rest", "--to", nobody), f"--to {nobody}: no computer with this name")


def test_a_recording_that_never_began_leaves_no_folder_and_names_one_that_cannot_be(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    refused(ask("live", "record", "replay:nowhere.inslab", "drive", "--out", str(folder)), "nowhere.inslab")
    assert not folder.exists()
    (tmp_path / "file").write_text("")
    folder = tmp_path / "file" / "new"
    refused(ask("live", "record", "udp:5599", "drive", "--out", str(folder)), f"{folder}: cannot be made")
