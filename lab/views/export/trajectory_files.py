"""Trajectory files: where a vehicle was, how fast and at which attitude, for programs that evaluate it.

TUM is read by evo, ``.pos`` by RTKLIB, SBET by programs for laser scanners; csv and parquet hold a row for
each sample with all quantities, their σ, and the units in the names. The time is the clock of the log, or the
time from the start of the flight.

References
----------
M. Grupp, *evo: Formats*, https://github.com/MichaelGrupp/evo/wiki/Formats
T. Takasu, *RTKLIB ver. 2.4.2 Manual*, appendix B.1, positioning solution file.
Applanix, *POSPac MMS*: smoothed best estimate of trajectory; the record is that of PDAL's ``readers.sbet``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lab.analysis.errors import euler_sigma
from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import WEEK
from lab.experiment.result import Result
from lab.missions import LogMission, Mission
from lab.motion.frames import ecef
from lab.motion.frames.rotation import C_nb_from_euler, wrap
from lab.navigation.filters.error_models import ATT, POS, VEL
from lab.run.provenance import facts_block

MISSING = "parquet needs pyarrow, which is not installed: pip install 'ins-lab[parquet]'"
"""Why no parquet file is written."""
SBET = np.dtype([
    (name, "<f8")
    for name in (
        "time", "latitude", "longitude", "altitude", "x_velocity", "y_velocity", "z_velocity", "roll",
        "pitch", "platform_heading", "wander_angle", "x_body_acceleration", "y_body_acceleration",
        "z_body_acceleration", "x_body_rate", "y_body_rate", "z_body_rate",
    )
])  # fmt: skip
"""A record of an SBET file: 17 numbers in seconds, radians, metres."""
_BLOCK = 10_000
"""Rows that are made to text at a time."""
_SINGLE = 5
"""Quality of a position whose kind is not stated: RTKLIB's single."""
_NAMES = (
    "time_s", "latitude_deg", "longitude_deg", "height_m", "velocity_north_m_s", "velocity_east_m_s",
    "velocity_down_m_s", "roll_deg", "pitch_deg", "heading_deg", "sigma_position_north_m",
    "sigma_position_east_m", "sigma_position_down_m", "sigma_velocity_north_m_s", "sigma_velocity_east_m_s",
    "sigma_velocity_down_m_s", "sigma_roll_deg", "sigma_pitch_deg", "sigma_heading_deg",
)  # fmt: skip
"""Columns of csv and parquet."""
_ROW = "%.9f,%.12f,%.12f" + ",%.6f" * 4 + ",%.9f" * 3 + ",%.6g" * 9
"""Decimals of these: 1 ns, 0.1 µm, 1 µm/s, 1e-9°, six digits of σ."""
_POS_HEAD = (
    "% program   : INS Lab\n"
    "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n"
    "%  GPST                latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  "
    "sdne(m)  sdeu(m)  sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)\n"
)
_POS_ROW = (
    f"%4d %13.6f %14.9f %14.9f %10.4f {_SINGLE:3d}   0" + " %8.4f" * 6 + "   0.00    0.0" + " %10.5f" * 3
)
"""A row: week, seconds, position, quality, no satellites, σ, age and ratio of an ambiguity, velocity."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion of a vehicle over time.

    Attributes
    ----------
    time : (n,) array
        Times in the clock of the file [s].
    position : (n, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (n, 3) array
        Velocity north, east, down [m/s].
    euler : (n, 3) array
        Roll, pitch, heading [rad].
    origin : (3,) array
        Position from which TUM counts: that of the first sample of the flight, or of the log's reference.
    sigma : (n, 9) array
        σ of position [m] and velocity [m/s] north, east, down, and of roll, pitch, heading [rad]; NaN where
        unknown.
    covariance : (n, 3) array
        Covariances of position: north and east, north and down, east and down [m²].
    """

    time: FloatArray
    position: FloatArray
    velocity_n: FloatArray
    euler: FloatArray
    origin: FloatArray
    sigma: FloatArray
    covariance: FloatArray

    @property
    def attitude_e(self) -> FloatArray:
        """C_eb (n, 3, 3): the body's axes in e."""
        C_en = ecef.axes(self.position[:, 0], self.position[:, 1])
        return np.asarray(C_en @ C_nb_from_euler(self.euler))


def make_trajectory(source: Result | Mission) -> Trajectory:
    """Return the estimated trajectory of a run, that recorded of a mission, or the reference of a log.

    Raises
    ------
    MissionError
        If a mission cannot be read, or is a log without a reference that has an attitude.
    """
    if isinstance(source, Result):
        solution = source.solution_arrays
        variance, covariance = solution.variance.astype(float), solution.covariance.astype(float)
        angles = euler_sigma(source.euler, variance[:, ATT], covariance[:, 1])
        return Trajectory(
            source.time + source.epoch,
            solution.position,
            solution.velocity_n.astype(float),
            source.euler.astype(float),
            _origin(source),
            np.column_stack((np.sqrt(variance[:, POS]), np.sqrt(variance[:, VEL]), angles)),
            covariance[:, 0],
        )
    if isinstance(source, LogMission):
        reference = _reference(source)
        if reference is None:
            raise MissionError(
                f"{source.name}: the log has no reference with position, velocity and attitude; accepted is "
                "such a log, or a run of it"
            )
        time, position, velocity, euler = reference
    else:
        flight = source.recording
        time = flight.time - flight.time[0]
        position = np.column_stack((flight.latitude, flight.longitude, flight.height))
        velocity, euler = flight.velocity_n, flight.euler
    unknown = np.full((len(time), 9), np.nan)
    return Trajectory(time, position, velocity, euler, position[0], unknown, unknown[:, :3])


def _origin(result: Result) -> FloatArray:
    """Return where TUM counts from: the same place for a run and for its mission."""
    reference = _reference(result.mission) if isinstance(result.mission, LogMission) else None
    if reference is not None:
        return np.asarray(reference[1][0])
    if result.recorded is None and result.truth_arrays is not None:
        return np.asarray(result.truth_arrays.position[0])
    return np.asarray(result.solution_arrays.position[0])


def _reference(mission: LogMission) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
    """Return time, position, velocity and attitude of a log's reference where it has all of them."""
    one, epoch = mission.log.reference, mission.log.epoch
    if one is None:
        return None
    known = np.isfinite(np.column_stack((one.position, one.velocity_n, one.euler))).all(axis=1)
    if not known.any():
        return None
    return one.time[known] + epoch, one.position[known], one.velocity_n[known], one.euler[known]


def tum(trajectory: Trajectory, facts: Mapping[str, Any]) -> Iterator[bytes]:
    """Yield a TUM file: time, metres east, north, up of the origin, and the quaternion of b, scalar last.

    Comments say what made it.
    """
    latitude, longitude = trajectory.origin[:2]
    north_east_down = ecef.axes(latitude, longitude)
    axes = np.column_stack((north_east_down[:, 1], north_east_down[:, 0], -north_east_down[:, 2]))
    place = (ecef.position(trajectory.position) - ecef.position(trajectory.origin[None])) @ axes
    quaternion = Rotation.from_matrix(axes.T @ trajectory.attitude_e).as_quat()
    degrees = np.degrees(trajectory.origin[:2])
    yield facts_block(facts, "# ").encode()
    yield (
        f"# east, north, up from latitude {degrees[0]:.12g} deg, longitude {degrees[1]:.12g} deg, "
        f"height {trajectory.origin[2]:.6f} m; body axes forward, right, down\n"
        "# timestamp tx ty tz qx qy qz qw\n"
    ).encode()
    table = np.column_stack((trajectory.time, place, quaternion))
    yield from _lines("%.9f" + " %.6f" * 3 + " %.9f" * 4, table)


def pos(trajectory: Trajectory, facts: Mapping[str, Any]) -> Iterator[bytes]:
    """Yield a solution file of RTKLIB, with weeks and seconds, and velocities, and what made it."""
    week = np.floor(trajectory.time / WEEK)
    latitude, longitude, height = trajectory.position.T
    sigma = trajectory.sigma[:, :3]
    north_east, north_down, east_down = trajectory.covariance.T
    off = np.column_stack((north_east, -east_down, -north_down))
    north, east, down = trajectory.velocity_n.T
    first, _, columns = _POS_HEAD.partition("\n")
    yield f"{first}\n{facts_block(facts, '% ')}{columns}".encode()
    table = np.column_stack((
        week, trajectory.time - week * WEEK, np.degrees(latitude), np.degrees(wrap(longitude)), height,
        np.nan_to_num(sigma), np.nan_to_num(np.sign(off) * np.sqrt(np.abs(off))), north, east, -down,
    ))  # fmt: skip
    yield from _lines(_POS_ROW, table)


def sbet(trajectory: Trajectory, _facts: Mapping[str, Any]) -> Iterator[bytes]:
    """Yield an SBET file; its wander angle is zero, so that x, y and z of velocities are north, east, down.

    There is no room for what made it.
    Accelerations and rates are those over the Earth along the body's axes, of central differences.
    """
    time, records = trajectory.time, np.zeros(len(trajectory.time), SBET)
    # Seconds of the week in which the file begins, which go on beyond its end.
    records["time"] = time - WEEK * np.floor(time[0] / WEEK)
    records["latitude"], records["longitude"] = trajectory.position[:, 0], wrap(trajectory.position[:, 1])
    records["altitude"] = trajectory.position[:, 2]
    C_eb = trajectory.attitude_e
    if len(time) > 1:
        C_en = ecef.axes(trajectory.position[:, 0], trajectory.position[:, 1])
        velocity_e = np.einsum("nij,nj->ni", C_en, trajectory.velocity_n)
        acceleration = np.einsum("nji,nj->ni", C_eb, np.gradient(velocity_e, time, axis=0))
        before, after = (
            np.maximum(np.arange(len(time)) - 1, 0),
            np.minimum(np.arange(len(time)) + 1, len(time) - 1),
        )
        turn = Rotation.from_matrix(np.swapaxes(C_eb[before], 1, 2) @ C_eb[after]).as_rotvec()
        rate = turn / (time[after] - time[before])[:, None]
        for at, axis in enumerate("xyz"):
            records[f"{axis}_body_acceleration"], records[f"{axis}_body_rate"] = (
                acceleration[:, at],
                rate[:, at],
            )
    for at, axis in enumerate("xyz"):
        records[f"{axis}_velocity"] = trajectory.velocity_n[:, at]
    records["roll"], records["pitch"] = trajectory.euler[:, 0], trajectory.euler[:, 1]
    records["platform_heading"] = wrap(trajectory.euler[:, 2])
    yield records.tobytes()


def trajectory_columns(trajectory: Trajectory) -> dict[str, FloatArray]:
    """Return the columns of csv and parquet by name; those of σ only where it is known."""
    latitude, longitude, height = trajectory.position.T
    columns = (
        trajectory.time, np.degrees(latitude), np.degrees(wrap(longitude)), height, *trajectory.velocity_n.T,
        *np.degrees(trajectory.euler).T, *trajectory.sigma[:, :6].T, *np.degrees(trajectory.sigma[:, 6:]).T,
    )  # fmt: skip
    known = dict(zip(_NAMES, columns, strict=True))
    return {name: one for name, one in known.items() if np.isfinite(one).any()}


def csv(trajectory: Trajectory, facts: Mapping[str, Any]) -> Iterator[bytes]:
    """Yield a csv file with what made it in comments, a header, and a row for each sample."""
    columns = trajectory_columns(trajectory)
    yield facts_block(facts, "# ", short=True).encode()
    yield (",".join(columns) + "\n").encode()
    forms = dict(zip(_NAMES, _ROW.split(","), strict=True))
    for block in _lines(",".join(forms[name] for name in columns), np.column_stack(list(columns.values()))):
        yield block.replace(b"nan", b"")


def parquet(trajectory: Trajectory, facts: Mapping[str, Any]) -> Iterator[bytes]:
    """Yield a parquet file with the columns of the csv, and what made it in its metadata.

    Raises
    ------
    MissionError
        If pyarrow is not installed.
    """
    try:
        from pyarrow import BufferOutputStream, table  # noqa: PLC0415 - an extra
        from pyarrow.parquet import write_table  # noqa: PLC0415 - an extra
    except ImportError:
        raise MissionError(MISSING) from None
    out = BufferOutputStream()
    write_table(
        table(trajectory_columns(trajectory)).replace_schema_metadata({"ins-lab": facts_block(facts)}), out
    )
    yield out.getvalue().to_pybytes()


def _lines(form: str, table: FloatArray) -> Iterator[bytes]:
    """Yield rows as text, some at a time."""
    for start in range(0, len(table), _BLOCK):
        yield "".join([f"{form}\n" % tuple(row) for row in table[start : start + _BLOCK].tolist()]).encode()


WRITERS = {".tum": tum, ".pos": pos, ".sbet": sbet, ".out": sbet, ".solution.csv": csv, ".parquet": parquet}
"""What writes a trajectory, by the end of the file's name."""
