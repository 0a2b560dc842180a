"""``ins-lab import --as log`` of bytes that a device sent, saved by another program or by the lab."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from asking import ask, refused

from lab.data.protocols.catalogue import ENCODERS
from lab.data.streams.raw_recording import RawWriter
from lab.data.streams.transport import Chunk
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.missions import missions

END = 60.0
"""End of what the device sent [s]."""


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder of one's own missions; the command is given in another one."""
    folder = tmp_path / "own"
    monkeypatch.setenv("INS_LAB_MISSIONS", str(folder))
    monkeypatch.chdir(tmp_path)
    return folder


@pytest.fixture(scope="module")
def flight() -> SimulatedFlight:
    return SimulatedFlight.of("montreal", 100.0, seed=3, rest=15.0)


def sent(flight: SimulatedFlight, device: str, *, imu: bool = True) -> list[Chunk]:
    """Return what a device sends: ten samples at a time, fixes 0.15 s late."""
    encoder, fixes, chunks = ENCODERS[device](), 0, []
    for end in range(10, round(END * flight.rate), 10):
        now = float(flight.imu["time"][end - 1])
        due = int(np.searchsorted(flight.fix["time"], now - 0.15))
        data = encoder.encode(flight.imu[end - 10 : end if imu else end - 10], flight.fix[:0])
        data += encoder.encode(flight.imu[:0], flight.fix[fixes:due]) if due > fixes else b""
        fixes = due
        chunks.append(Chunk(100.0 + now, data))
    return chunks


@pytest.mark.proof
@pytest.mark.parametrize("device", ["vectornav", "ublox", "novatel"])
def test_a_capture_becomes_a_log_that_runs(flight: SimulatedFlight, tmp_path: Path, device: str) -> None:
    path = tmp_path / "drive.bin"
    path.write_bytes(b"".join(chunk.data for chunk in sent(flight, device)))
    answer = ask("import", str(path), "--as", "log", "--vehicle", "aeroplane")
    assert answer.exit_code == 0, answer.output
    assert answer.stdout.splitlines()[-1] == "Added: drive.bin. Navigate it: ins-lab run drive.bin"
    log = missions()["drive.bin"].log
    assert log.auxiliary.vehicle == "aeroplane"
    assert log.duration == pytest.approx(END, abs=1.0)
    # The samples are those of the device, forward, right, down.
    force = np.median(log.rates[1], axis=0)
    np.testing.assert_allclose(force, np.median(flight.imu["force"][:6000], axis=0), atol=0.1)


def test_a_raw_recording_becomes_a_log_of_its_name(flight: SimulatedFlight, tmp_path: Path) -> None:
    path = tmp_path / "drive.inslab"
    writer = RawWriter(path, {"protocol": "vectornav"})
    for chunk in sent(flight, "vectornav"):
        writer.accept(chunk)
    writer.close()
    answer = ask("import", str(path), "--as", "log")
    assert answer.stdout.splitlines()[-1] == "Added: drive. Navigate it: ins-lab run drive"
    facts = json.loads(ask("import", str(path), "--as", "log", "--vehicle", "car", "--json").stdout)
    assert (facts["added"], facts["vehicle"]) == ("drive_2", "car")


def test_a_damaged_recording_is_refused_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "damaged.inslab"
    path.write_bytes(b"INS Lab raw recording 1\n{}\n" + b"\xff" * 100)
    answer = ask("import", str(path), "--as", "log")
    refused(answer, "damaged.inslab: damaged at byte 27")
    assert "standard output" not in answer.stderr


@pytest.mark.proof
def test_axes_are_those_of_the_device(flight: SimulatedFlight, tmp_path: Path) -> None:
    path = tmp_path / "up.bin"
    path.write_bytes(b"".join(chunk.data for chunk in sent(flight, "vectornav")))
    refused(
        ask("import", str(path), "--as", "log", "--axes", "x,-y,-z"), "gravity", "--axes of ins-lab import"
    )
    answer = ask("import", str(path), "--as", "log", "--axes", "-x,-y,z")
    assert answer.exit_code == 0, answer.output
    forward = np.median(missions()["up.bin"].log.rates[1][:, 0])
    assert forward == pytest.approx(-np.median(flight.imu["force"][:6000, 0]), abs=0.1)


def test_a_receiver_without_an_imu_is_refused_and_its_flight_is_not(
    flight: SimulatedFlight, tmp_path: Path
) -> None:
    path = tmp_path / "gps.ubx"
    path.write_bytes(b"".join(chunk.data for chunk in sent(flight, "ublox", imu=False)))
    refused(ask("import", str(path), "--as", "log"), "is u-blox UBX, which has no IMU")
    assert ask("import", str(path)).exit_code == 0
