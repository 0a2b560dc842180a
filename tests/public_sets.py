"""Small made inputs in the layouts of the public data sets of the scoreboard."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymap3d
from scipy.io import savemat
from scipy.spatial.transform import Rotation
from sensor_logs import EPOCH, Tables, tables, write
from writers import WRITERS
from xplane_simulator import montreal

G = 9.80665
GPS_EPOCH = 1756402239.0 - EPOCH
"""What the time of the tables is in seconds since 1970."""
NCLT = 42.293227, -83.709657, 270.0


def made(seconds: float = 90.0) -> Tables:
    """Return the tables of a flight at 50 Hz."""
    found = tables(20, 20 + seconds)
    return found._replace(imu=found.imu[::2])


def gnss_imu(folder: Path, log: Tables, *, recorded: bool = False) -> Path:
    """Write a walk of GNSS_IMU: forward is -y, right is -x, down is -z of its IMU."""
    folder.mkdir()
    time, body = log.imu[:, 0] + GPS_EPOCH, log.imu[:, 1:].reshape(-1, 2, 3)
    gyro, force = (np.column_stack((-one[:, 1], -one[:, 0], -one[:, 2])) for one in (body[:, 0], body[:, 1]))
    if recorded:
        # As recorded: a heading, milliseconds of its own clock, °/s, and a last line that is cut.
        since = np.round(time - time[0], 6)
        rows = np.column_stack((force / G, np.degrees(gyro), 5000 + 1000 * since))
        lines = [",".join(f"{cell:.9f}" for cell in row) for row in rows]
        (folder / "imu_1730.csv").write_text("\n".join(("ax,ay,az,gx,gy,gz,ms", *lines, "0.1,0.")))
        seconds = int(time[0])
        tag = struct.pack("<60sIId", b"TIMETAG RTKLIB", 77, seconds, time[0] - seconds)
        tag += struct.pack("<IIII", 0, 0, round(1000 * since[-1]), 4096)
        (folder / "imu_1730.csv.tag").write_bytes(tag)
    else:
        table = np.column_stack((time, force / G, gyro, np.zeros((len(time), 4))))
        np.savetxt(folder / "imu_1730_sf.csv", table, delimiter=",", fmt="%.9f")
    lines = ["%  GPST            latitude(deg) longitude(deg) height(m) Q ns ..."]
    for row in log.gnss:
        stamp = np.datetime64(round(1000 * (row[0] + GPS_EPOCH)), "ms").astype(str).replace("-", "/")
        cells = [*row[1:4], 1, 25, *row[7:10], *np.zeros(5), row[4], row[5], -row[6], *row[10:13], 0, 0, 0]
        lines.append(stamp.replace("T", " ") + " " + " ".join(f"{cell:.9f}" for cell in cells))
    (folder / "gnss_1730_sf.pos").write_text("\n".join(lines) + "\n")
    return folder


def navego(folder: Path, log: Tables, number: str = "1", *, compressed: bool = True) -> Path:
    """Write a synthetic set of NaveGo."""
    folder.mkdir()
    zero = log.imu[0, 0]
    imu = {"t": log.imu[:, :1] - zero, "wb": log.imu[:, 1:4], "fb": log.imu[:, 4:7], "freq": 50.0}

    def place(table: np.ndarray) -> dict[str, np.ndarray]:
        lat, lon = np.radians(table[:, 1:2]), np.radians(table[:, 2:3])
        return {"t": table[:, :1] - zero, "lat": lat, "lon": lon, "h": table[:, 3:4], "vel": table[:, 4:7]}

    gnss = {
        **place(log.gnss),
        "stdm": log.gnss[0, 7:10],
        "stdv": log.gnss[0, 10:13],
        "larm": np.zeros((3, 1)),
    }
    euler = np.radians(log.reference[:, 7:10])
    ref = {**place(log.reference), "roll": euler[:, :1], "pitch": euler[:, 1:2], "yaw": euler[:, 2:3]}
    for file, name, content in (
        (f"imu{number}.mat", f"imu{number}", imu),
        ("gnss.mat", "gnss", gnss),
        ("ref.mat", "ref", ref),
    ):
        savemat(folder / file, {name: content}, do_compression=compressed)
    return folder


def canada(folder: Path, log: Tables) -> Path:
    """Write a rover of NaveGo: its reference has no attitude."""
    navego(folder, log)
    from scipy.io import loadmat

    for old, new, name in (
        ("imu1", "imu_planetary", "imu_planetary"),
        ("gnss", "gnss_planetary", "gnss_planetary"),
        ("ref", "gnss_planetary_r", "gnss_planetary_r"),
    ):
        fields = loadmat(folder / f"{old}.mat")[old]
        kept = {key: fields[key].item() for key in fields.dtype.names if key not in ("roll", "pitch", "yaw")}
        (folder / f"{old}.mat").unlink()
        savemat(folder / f"{new}.mat", {name: kept})
    return folder


def moved(table: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return a table whose positions are as far from the origin of NCLT as they were from another place."""
    ned = pymap3d.geodetic2ned(*table[:, 1:4].T, *origin)
    found = table.copy()
    found[:, 1:4] = np.column_stack(pymap3d.ned2geodetic(*ned, *NCLT))
    return found


def nclt(folder: Path, log: Tables) -> Path:
    """Write a session of NCLT."""
    folder.mkdir()
    origin = log.gnss[0, 1:4]
    gnss, reference = moved(log.gnss, origin), moved(log.reference, origin)
    micro = np.round(1e6 * (log.imu[:, :1] + GPS_EPOCH))
    np.savetxt(
        folder / "ms25.csv",
        np.hstack((micro, np.zeros((len(micro), 3)), log.imu[:, 4:7], log.imu[:, 1:4])),
        delimiter=",",
        fmt=["%.0f", *["%.9f"] * 9],
    )
    north, east = gnss[:, 4], gnss[:, 5]
    rows = np.column_stack(
        (
            np.round(1e6 * (gnss[:, 0] + GPS_EPOCH)), np.full(len(gnss), 3), np.full(len(gnss), 8),
            np.radians(gnss[:, 1:3]), gnss[:, 3], np.arctan2(east, north) % (2 * np.pi),
            np.hypot(north, east),
        )
    )  # fmt: skip
    rows[3, 1], rows[3, 3:6] = 0, np.nan  # no fix
    np.savetxt(folder / "gps.csv", rows, delimiter=",", fmt=["%.0f", "%.0f", "%.0f", *["%.12f"] * 5])
    ned = np.column_stack(pymap3d.geodetic2ned(*reference[:, 1:4].T, *NCLT))
    truth = np.column_stack(
        (np.round(1e6 * (reference[:, 0] + GPS_EPOCH)), ned, np.radians(reference[:, 7:10]))
    )
    np.savetxt(folder / "groundtruth_2012-01-08.csv", truth, delimiter=",", fmt=["%.0f", *["%.9f"] * 6])
    return folder


def _npy(path: Path, values: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        np.save(file, values)


def comma2k19(folder: Path, log: Tables) -> Path:
    """Write a segment of comma2k19; the gyros are sampled between the accelerometers."""
    times = log.imu[:, 0]
    for kind, values in (("gyro_uncalibrated", log.imu[:, 1:4]), ("accelerometer", log.imu[:, 4:7])):
        _npy(folder / "processed_log" / "IMU" / kind / "t", times)
        _npy(folder / "processed_log" / "IMU" / kind / "value", values)
    gnss = log.gnss
    course = np.degrees(np.arctan2(gnss[:, 5], gnss[:, 4])) % 360
    speed = np.hypot(gnss[:, 4], gnss[:, 5])
    value = np.column_stack((gnss[:, 1:3], speed, gnss[:, 0], gnss[:, 3], course))
    _npy(folder / "processed_log" / "GNSS" / "live_gnss_ublox" / "t", gnss[:, 0])
    _npy(folder / "processed_log" / "GNSS" / "live_gnss_ublox" / "value", value)
    ref = log.reference
    lat, lon, height = ref[:, 1:4].T
    _npy(folder / "global_pose" / "frame_times", ref[:, 0])
    _npy(folder / "global_pose" / "frame_positions", np.column_stack(pymap3d.geodetic2ecef(lat, lon, height)))
    enu = ref[:, 5], ref[:, 4], -ref[:, 6]
    velocity = np.column_stack(pymap3d.enu2uvw(*enu, lat, lon))
    _npy(folder / "global_pose" / "frame_velocities", velocity)
    axes = [
        np.column_stack(pymap3d.enu2uvw(*(np.full(len(ref), one) for one in axis), lat, lon))
        for axis in ((0, 1, 0), (1, 0, 0), (0, 0, -1))
    ]
    C_en = np.stack(axes, axis=-1)
    C_nb = Rotation.from_euler("ZYX", ref[:, [9, 8, 7]], degrees=True).as_matrix()
    _npy(
        folder / "global_pose" / "frame_orientations",
        Rotation.from_matrix(C_en @ C_nb).as_quat(scalar_first=True),
    )
    return folder


def phone(folder: Path, log: Tables) -> Path:
    """Write a drive of Nav Sensor Recorder: forward is -z, right is x, down is -y of the phone."""
    folder.mkdir()
    body = log.imu[:, 1:].reshape(-1, 2, 3)
    nano = [f"{473_997_000_000_000 + round(1e9 * (time - EPOCH))}" for time in log.imu[:, 0]]
    for name, at, unit in (("Gyro", 0, "rad/s"), ("Acc", 1, "m/s^2")):
        head = f"Sensor: LSM6DSL\nVendor: STM\nTimestamp{name} [ns]; " + "; ".join(
            f"{name}{axis} [{unit}]" for axis in "XYZ"
        )
        rows = np.column_stack((body[:, at, 1], -body[:, at, 2], -body[:, at, 0]))
        lines = [f"{t};" + "".join(f"{cell:.6f};" for cell in row) for t, row in zip(nano, rows, strict=True)]
        (folder / f"20201104_{name}.csv").write_text("\n".join((head, *lines)) + "\n")
    lines = [
        "TimestampGNSS [ns]; UTC time [ms]; Lat [deg]; Lon [deg]; Height [m]; Speed [m/s]; Heading [deg]; "
        "Hor Acc [m]; Vert Acc [m]; Speed Acc [m/s]; Heading Acc [deg]"
    ]
    for row in log.gnss[::2]:
        course = np.degrees(np.arctan2(row[5], row[4])) % 360
        stamp = 473_997_000_000_000 + round(1e9 * (row[0] - EPOCH))
        cells = (*row[1:3], row[3], np.hypot(row[4], row[5]), course, 2, 100, 0.5, 10)
        lines.append(f"{stamp};{round(1000 * row[0])};" + "".join(f"{cell:.12f};" for cell in cells))
    (folder / "20201104_GNSS.csv").write_text("\n".join(lines) + "\n")
    return folder


def kf_gins(folder: Path, seconds: int = 200) -> Path:
    """Write a data set of KF-GINS."""
    folder.mkdir(parents=True)
    files = WRITERS["KF-GINS text"](montreal(seconds))
    assert isinstance(files, dict)
    for name, content in files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return folder


WRITTEN: dict[str, Callable[[Path, Tables], Path]] = {
    "rtkx_walk": gnss_imu,
    "navego_adis16405": navego,
    "navego_adis16488": lambda folder, log: navego(folder, log, "2", compressed=False),
    "navego_canada": canada,
    "nclt": nclt,
    "comma2k19": comma2k19,
    "oan_drive_short": phone,
    "vn310_static": write,
}
"""What writes a made set, by the name of the set."""
