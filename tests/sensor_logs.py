"""Logs of an IMU and a GPS receiver, simulated on the mission montreal, as the files a recorder writes."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lab.missions import mission
from lab.motion.truth.trajectory import Trajectory, Truth

IMU = ("t_s", "gx_rad_s", "gy_rad_s", "gz_rad_s", "fx_m_s2", "fy_m_s2", "fz_m_s2")
INCREMENTS = (
    "t_s", "dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad", "dvelocity_x_m_s", "dvelocity_y_m_s",
    "dvelocity_z_m_s",
)  # fmt: skip
POSITION = ("t_s", "lat_deg", "lon_deg", "alt_m")
VELOCITY = ("vn_m_s", "ve_m_s", "vd_m_s")
SIGMA = ("sd_n_m", "sd_e_m", "sd_d_m", "sd_vn_m_s", "sd_ve_m_s", "sd_vd_m_s")
ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")
EPOCH = 1000.0
LATENCY = {"comma2k19": -0.1}
"""By how much the stamps of the fixes in real recordings are late [s]."""
RATE = 100.0


class Tables(NamedTuple):
    """Columns of imu.csv, gnss.csv and ref.csv."""

    imu: np.ndarray
    gnss: np.ndarray
    reference: np.ndarray


@cache
def trajectory() -> Trajectory:
    """Return the flight at the rate of the logs."""
    return Trajectory.from_recording(mission("montreal").recording, RATE)


def tables(
    start: float,
    end: float,
    lever_arm=(0.0, 0.0, 0.0),
    seed: int = 1,
    flight: Trajectory | None = None,
) -> Tables:
    """Return what sensors with a little noise and bias would log between two times of a flight."""
    flight = flight or trajectory()
    ideal, rng = flight.increments(RATE), np.random.default_rng(seed)
    rows = (ideal.time[1:] >= start) & (ideal.time[1:] <= end)
    imu = np.column_stack((ideal.time[1:], ideal.dtheta * RATE, ideal.dvelocity * RATE))[rows]
    imu[:, 1:4] += np.radians((0.1, -0.2, 0.15)) + rng.normal(scale=1e-3, size=(len(imu), 3))
    imu[:, 4:] += np.array((0.02, -0.01, 0.03)) + rng.normal(scale=0.02, size=(len(imu), 3))
    times = np.arange(np.ceil(start), end, 0.5)
    truth = flight.at(times)
    turn, _ = flight.rates(times)
    C = rotation_matrices(truth)
    arm = C @ np.array(lever_arm)
    swing = np.einsum("nij,nj->ni", C, np.cross(turn, lever_arm))
    position = degrees(truth)
    north, east, down = (arm + rng.normal(scale=0.5, size=arm.shape)).T
    position += np.stack((north / 111_200, east / (111_320 * np.cos(truth.latitude)), -down), axis=-1)
    velocity = truth.velocity_n + swing + rng.normal(scale=0.1, size=swing.shape)
    sigma = np.tile((0.5, 0.5, 0.5, 0.1, 0.1, 0.1), (len(times), 1))
    gnss = np.column_stack((times, position, velocity, sigma))
    reference = np.column_stack((times, degrees(truth), truth.velocity_n, np.degrees(truth.euler)))
    for table in (imu, gnss, reference):
        table[:, 0] += EPOCH
    return Tables(imu, gnss, reference)


def degrees(truth: Truth) -> np.ndarray:
    """Return the position as the files have it."""
    return np.stack((np.degrees(truth.latitude), np.degrees(truth.longitude), truth.height), axis=-1)


def rotation_matrices(truth: Truth) -> np.ndarray:
    """Return C_nb (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(truth.q_nb, scalar_first=True).as_matrix()


def write_csv(path: Path, names: tuple[str, ...], table: np.ndarray) -> Path:
    """Write a file with a header."""
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
    return path


def write(folder: Path, log: Tables, toml: str | None = None, imu_names=IMU) -> Path:
    """Write a whole log into a folder, and return the folder."""
    folder.mkdir(exist_ok=True)
    write_csv(folder / "imu.csv", imu_names, log.imu)
    write_csv(folder / "gnss.csv", (*POSITION, *VELOCITY, *SIGMA)[: log.gnss.shape[1]], log.gnss)
    write_csv(folder / "ref.csv", (*POSITION, *VELOCITY, *ATTITUDE), log.reference)
    if toml is not None:
        (folder / "log.toml").write_text(toml)
    return folder


def described(folder: Path, source: Path) -> Path:
    """Copy a real recording, its ``meta.json`` turned into the ``log.toml`` of the lab.

    Of the stamps in the csv of comma2k19 the latency in its ``meta.json`` is taken off already, and too much:
    IMU and fixes alone, without the reference, tell that what is left is `LATENCY`.
    """
    import json
    import shutil

    folder.mkdir(exist_ok=True)
    for name in ("imu.csv", "gnss.csv", "ref.csv"):
        shutil.copy(source / name, folder / name)
    meta = json.loads((source / "meta.json").read_text())
    (folder / "log.toml").write_text(
        f'title = "{meta["name"]}"\nlever_arm_m = {meta["lever_imu_to_antenna_frd_m"]}\n'
        f"latency_s = {LATENCY.get(source.name, 0.0)}\n"
    )
    return folder


def changed(value: float | tuple[float, ...], bounds: tuple[float, float]) -> float | tuple[float, ...]:
    """Return another value of a setting, or of each of its axes, within its bounds."""
    if isinstance(value, tuple):
        return tuple(float(changed(one, bounds)) for one in value)  # type: ignore[arg-type]
    return min(value * 1.3 + 1e-3, bounds[1])
