"""Files, folders and missions that the documents name as the reader's: what makes each of them."""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import public_sets
from calibration_logs import bench, errors, fields, write_bench
from calibration_logs import drive as askew_drive
from copter_logs import copter
from document_code import ROOT, blocks
from estimator_logs import ekf3, px4
from sensor_logs import EPOCH, IMU, Tables, tables, write, write_csv
from typer.testing import CliRunner
from writers import WRITERS
from xplane_simulator import montreal

from dashboards.command_line import app
from lab.data.log.calibration import Calibration, Linear
from lab.data.protocols.catalogue import ENCODERS
from lab.data.streams.axis_map import AxisMap
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.missions import add_mission


def toml_of(document: str, number: int) -> str:
    """Return the text of a TOML block of a document."""
    found = [block.text for block in blocks(ROOT / document) if block.language == "toml"]
    return found[number]


def written(path: Path, content: str | bytes) -> None:
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def drive(path: Path) -> None:
    """Write a log at 25 Hz, with a clock that begins at 20 s."""
    imu, gnss, reference = tables(20, 110)
    for table in (imu, gnss, reference):
        table[:, 0] -= EPOCH
    write(path, Tables(imu[::4], gnss, reference))


def of_bench(path: Path) -> None:
    """Write a log of an IMU that rests in many attitudes, with turns between them."""
    rng = np.random.default_rng(1)
    write_bench(path, *bench(rng, errors(rng)))


def of_car(path: Path) -> None:
    """Write the log of a drive whose IMU is mounted askew."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        askew_drive(Path(folder), 3, -0.4, 0.5)
        (Path(folder) / "log").rename(path)


def calibration() -> Calibration:
    """Return constant errors of a sensor."""
    return Calibration(source="bench.csv", gyro=Linear(np.array([0.01, -0.01, 0.0]), np.eye(3)))


def of_compass(path: Path) -> None:
    """Write the fields of a magnetometer that turns in all directions."""
    time, values = fields(np.random.default_rng(1), np.eye(3), np.array([20.0, -10.0, 5.0]))
    write_csv(path, ("t_s", "mx_uT", "my_uT", "mz_uT"), np.column_stack((time, values)))


def logged(path: Path) -> None:
    """Write the fixes of a logger whose headings say nothing."""
    rows = [f"{200 * i},{465_000_000 + 900 * i},{70_000_000 + 400 * i},{90_000 + i}" for i in range(99)]
    written(path, "\n".join(("t_ms,q1,q2,q3", *rows)))


def at_rest(path: Path) -> None:
    """Write five minutes of an IMU at rest."""
    rng = np.random.default_rng(1)
    rows = rng.normal(scale=[1e-3] * 3 + [1e-2] * 3, size=(30_000, 6)) - [0, 0, 0, 0, 0, 9.8]
    write_csv(path, IMU, np.column_stack((np.arange(30_000) / 100, rows)))


_KF_GINS = {"IMU.txt": "IMU.txt", "GNSS.txt": "GNSS-RTK.txt", "truth.nav": "truth.nav"}
"""Files of KF-GINS, and which one of the writer each is."""


def kf_gins(name: str, path: Path) -> None:
    """Write one of the files of KF-GINS."""
    files = WRITERS["KF-GINS text"](montreal(60))
    assert isinstance(files, dict)
    written(path, files[name])


def algorithm(path: Path) -> None:
    """Write the algorithm of the document under the name that its command lines have."""
    batch, live, _ = (block for block in blocks(ROOT / "docs/algorithms.md") if block.language == "python")
    text = batch.text.partition("\n\n\nresult")[0].replace("LastFix", "MyFilter")
    written(path, f"{text}\n\n\n{live.text}")


def made_homework(path: Path) -> None:
    """Make the homework of the document, with its key beside it."""
    path.with_suffix(".key").unlink(missing_ok=True)
    make_files("receiver.toml", path.parent)
    answered(["homework", "make", "receiver.toml", "--out", path.name])


def key_of_variants(path: Path) -> None:
    """Make the key of the document's homework with variants."""
    make_files("each.toml", path.parent)
    answered(["homework", "make", "each.toml", "--out", "each.homework"])


def roster(path: Path) -> None:
    """Write what Moodle exports of a class of two."""
    rows = (
        "First name,Last name,ID number,Email address",
        "Ada,Lovelace,1,ada@x.org",
        "Bob,Burns,2,bob@x.org",
    )
    written(path, "\n".join(rows))


def handed_in(path: Path) -> None:
    """Write a folder with what one student hands in."""
    path.mkdir()
    make_files("receiver.homework", path.parent)
    answered(
        ["homework", "hand-in", "receiver.homework", "--name", "Ada", "--out", f"{path.name}/ada.handin"]
    )


def answered(arguments: list[str]) -> None:
    """Run a command in the folder of the reader."""
    answer = CliRunner().invoke(app, arguments)
    assert answer.exit_code == 0, answer.output


def estimator_log(kind: str) -> bytes:
    """Return a log of an autopilot's filter whose innovations are as large as it says."""
    rng, time = np.random.default_rng(1), np.arange(100.0, 160.0, 0.2)
    if kind == "ulg":
        return px4(time, rng.normal(size=(len(time), 11)), np.ones((len(time), 11)))
    return ekf3(time, rng.normal(size=(len(time), 6)), np.ones((len(time), 6)))


def innovations(path: Path) -> None:
    """Write innovations of anyone's filter."""
    rows = np.random.default_rng(2).normal(size=(100, 3))
    rows[:, 0], rows[:, 2] = np.arange(100), 1.0
    write_csv(path, ("time [s]", "position east [m]", "position_sigma east [m]"), rows)


def zipped(path: Path) -> None:
    """Write a phone's table as a zip file."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("phone.csv", WRITERS["csv with named columns"](montreal(60)))


def capture(path: Path) -> None:
    """Write what a VectorNav sends of a minute of flight, its axes forward, left, up."""
    sent = SimulatedFlight.of("montreal", 50.0, rest=12.0, axes=AxisMap.of("x,-y,-z"))
    encoder, parts = ENCODERS["vectornav"](), []
    for second in range(60):
        of_imu, of_fix = (
            (rows["time"] >= second) & (rows["time"] < second + 1) for rows in (sent.imu, sent.fix)
        )
        parts.append(encoder.encode(sent.imu[of_imu], sent.fix[of_fix]))
    written(path, b"".join(parts))


MOTION = """ini lat (deg),ini lon (deg),ini alt (m),ini vx_body (m/s),ini vy_body (m/s),ini vz_body (m/s),\
ini yaw (deg),ini pitch (deg),ini roll (deg)
32,120,0,10,0,0,90,0,0
command type,yaw (deg),pitch (deg),roll (deg),vx_body (m/s),vy_body (m/s),vz_body (m/s),command duration (s),\
GPS visibility
1,-15,0,0,0,0,0,6,1
5,0,0,0,20,0,0,30,1
"""
FILES: dict[str, Callable[[Path], Any]] = {
    "Data.txt": lambda path: written(path, WRITERS["X-Plane Data.txt"](montreal(60))),
    "Data.csv": lambda path: written(path, WRITERS["MSFS/FSX fsLogger csv"](montreal(60))),
    "flight.ulg": lambda path: written(path, WRITERS["PX4 ULog"](montreal(60))),
    "copter.ulg": lambda path: written(path, estimator_log("ulg")),
    "copter.bin": lambda path: written(path, estimator_log("bin")),
    "innovations.csv": innovations,
    "my_flight.csv": lambda path: written(path, WRITERS["INS Lab flight csv"](montreal(60))),
    "phone.csv": lambda path: written(path, WRITERS["csv with named columns"](montreal(60))),
    "phone.zip": zipped,
    "capture.bin": capture,
    **{name: partial(kf_gins, one) for name, one in _KF_GINS.items()},
    "my_logger.csv": logged,
    "my_logger.toml": lambda path: written(path, toml_of("docs/profiles.md", 0)),
    "recordings": lambda path: public_sets.kf_gins(path / "kf_gins", 110),
    "my_drive": drive,
    "drive": drive,
    "my_car": of_car,
    "my_copter": lambda path: write(path, copter()),
    "imu.csv": at_rest,
    "still.csv": at_rest,
    "bench.csv": of_bench,
    "compass.csv": of_compass,
    "sensor.toml": lambda path: calibration().write(path),
    "fixes.ubx": lambda path: written(path, WRITERS["u-blox UBX"](montreal(120))),
    "settings.toml": lambda path: written(path, toml_of("docs/settings.md", 0)),
    "eight.toml": lambda path: written(path, toml_of("docs/flying.md", 0)),
    "my_plan.toml": lambda path: written(path, toml_of("missions/README.md", 3)),
    "motion_def.csv": lambda path: written(path, MOTION),
    "my_filter.py": algorithm,
    "my_lesson.toml": lambda path: written(path, toml_of("docs/lessons.md", 0)),
    "my_lessons": lambda path: (path.mkdir(), written(path / "mine.toml", toml_of("docs/lessons.md", 0))),
    "receiver.toml": lambda path: written(path, toml_of("docs/homework.md", 0)),
    "receiver.homework": made_homework,
    "each.toml": lambda path: written(path, toml_of("docs/homework.md", 1)),
    "each.key": key_of_variants,
    "class.csv": roster,
    "handed_in": handed_in,
    "mine": lambda path: add_mission(montreal(60), path.name, title="Mine"),
}
"""What makes the reader's files, folders and missions, by their name in the documents."""


def make_files(text: str, folder: Path) -> None:
    """Make the files of `FILES` that a text names and the folder in which commands run lacks."""
    for word in dict.fromkeys(re.findall(r"[\w.]+", text)):
        if word in FILES and not (folder / word).exists():
            FILES[word](folder / word)
