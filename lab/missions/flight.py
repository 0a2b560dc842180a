"""Flight: a plan flown, to its end or as far as it went, and recorded as a `Recording`."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lab.missions.catalogue import mission, own_folder, shipped_folder
from lab.missions.errors import MissionError
from lab.missions.flight_plan import FlightPlan
from lab.missions.flown_mission import add_flown, check_flown
from lab.missions.library import add_mission
from lab.missions.mission import Mission
from lab.missions.mission_name import suggested_name
from lab.missions.pilot import PATIENCE, Pilot
from lab.missions.recording import Recording
from lab.missions.simulated_aircraft import STEP_MS, Instruments, SimulatedAircraft

if TYPE_CHECKING:
    from lab.missions.motion_commands import MotionPlan
    from lab.missions.plan_kinds import Plan
    from lab.missions.waypoints import WaypointPlan

SAMPLE_MS = 55
"""Time between two samples of the record [ms]."""
PILOT_MS = 5
"""Time between two looks of the pilot at the instruments [ms]."""

_MOST_ROLL_ON_GROUND = math.radians(30.0)

SHORTEST = 2.0
"""Shortest flight that is kept [s]."""


@dataclass(frozen=True, eq=False)
class Flight:
    """What became of a plan.

    Attributes
    ----------
    recording : Recording
        What was flown: one sample every 55 ms of simulator time.
    ending : str
        Empty when the plan was flown to its end. Else a sentence for a person: what happened, when, during
        which manoeuvre, and what to change.
    """

    recording: Recording
    ending: str = ""


def fly(
    plan: Plan,
    seed: int | None = None,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Flight:
    """Fly a plan and return its record and, where it ended early, why.

    The same plan and seed give the same bits on the same machine. The last sample is the first one not before
    the plan's duration, or the last one before the flight ended. Waypoints and motion commands need no
    simulator, and are carried out at once.

    Parameters
    ----------
    plan
        What to fly.
    seed
        Seed of the turbulence; the plan's own by default.
    progress
        Called about every second of flight with the fraction flown, 0 to 1.
    cancelled
        Asked at every sample whether to end the flight here.

    Raises
    ------
    MissionError
        If JSBSim is missing, the flight ended before `SHORTEST` seconds were flown, the way or the motion
        cannot be carried out, or a seed is given for them, who have no turbulence.
    """
    if not isinstance(plan, FlightPlan):
        return _carry_out(plan, seed, progress)
    aeroplane = SimulatedAircraft(plan if seed is None else plan.with_seed(seed))
    pilot = Pilot(plan, PILOT_MS / 1000, aeroplane.trimmed)
    count = math.ceil(round(plan.duration_s * 1000) / SAMPLE_MS) + 1
    samples = np.empty((count, 12))
    flown, ending = _fly_samples(aeroplane, pilot, samples, progress, cancelled)
    if not ending and not pilot.on_last_manoeuvre:
        ending = (
            f"the flight of {plan.duration_s:g} s ended during manoeuvre {pilot.manoeuvre}: "
            "give duration_s more time or shorten the manoeuvres"
        )
    if flown < SHORTEST * 1000 / SAMPLE_MS:
        raise MissionError(ending or f"a flight of {plan.duration_s:g} s is too short")
    if progress is not None and flown == count:
        progress(1.0)
    return Flight(_recording(samples[:flown]), ending)


def _carry_out(
    plan: WaypointPlan | MotionPlan, seed: int | None, progress: Callable[[float], None] | None
) -> Flight:
    from lab.missions.motion_commands import MotionPlan, move  # noqa: PLC0415 - SciPy, for those who need it
    from lab.missions.waypoints import travel  # noqa: PLC0415

    _refuse(seed)
    recording = move(plan).recording if isinstance(plan, MotionPlan) else travel(plan)
    if progress is not None:
        progress(1.0)
    return Flight(recording)


def _refuse(seed: int | None) -> None:
    if seed is not None:
        raise MissionError(f"seed = {seed}: waypoints and commands have no turbulence; leave it out")


def _fly_samples(
    aeroplane: SimulatedAircraft,
    pilot: Pilot,
    samples: np.ndarray,
    progress: Callable[[float], None] | None,
    cancelled: Callable[[], bool] | None,
) -> tuple[int, str]:
    """Fill the samples; return how many were flown, and why no more."""
    last = (len(samples) - 1) * SAMPLE_MS
    for now in range(0, last + 1, STEP_MS):
        if now % PILOT_MS == 0:
            seen = aeroplane.instruments()
            ending = _check(seen, pilot, now)
            if ending:
                return math.ceil(now / SAMPLE_MS), ending
            aeroplane.move(pilot.fly(now / 1000, seen))
        if now % SAMPLE_MS == 0:
            if cancelled is not None and cancelled():
                return now // SAMPLE_MS, f"cancelled {now / 1000:.2f} s into the flight"
            if aeroplane.out_of_fuel():
                where = f"{now / 1000:.2f} s into the flight, during manoeuvre {pilot.manoeuvre}"
                return now // SAMPLE_MS, f"the aeroplane ran out of fuel {where}; give duration_s less time"
            samples[now // SAMPLE_MS] = aeroplane.sample()
            if progress is not None and now % (20 * SAMPLE_MS) == 0:
                progress(now / last)
        aeroplane.step()
    return len(samples), ""


def fly_mission(
    name_or_path: str | os.PathLike[str],
    *,
    seed: int | None = None,
    folder: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Mission:
    """Fly a mission's plan and write the mission: its TOML file and the new recording beside it.

    With the mission's own seed, the recording is the same, bit by bit. A flight that ended early is written
    as far as it went, and the mission's `ending` says why.

    Parameters
    ----------
    name_or_path
        As for `mission`; the TOML file has a ``[flight]`` table, its recording need not exist yet. Or a
        motion definition csv of gnss-ins-sim, which becomes a mission of the file's name in your own folder.
    seed
        Seed of the turbulence, written into the new TOML file; the plan's own by default.
    folder
        Where to write; by default the user's own folder for a shipped mission, or else the mission's folder.
    overwrite
        True replaces an existing recording and TOML file of that name. If the TOML file changes, the new
        recording has a file name of its own, and the old one goes afterwards: a crash leaves the one or the
        other mission whole.
    progress
        Called about every second of flight with the fraction flown, 0 to 1.
    cancelled
        Asked at every sample whether to end the flight here.

    Returns
    -------
    Mission
        As written.

    Raises
    ------
    MissionError
        If files exist already and may not be replaced, or as for `fly`; nothing is written then.
    """
    if _is_motion(Path(name_or_path)):
        _refuse(seed)
        return _move_file(Path(name_or_path), folder, overwrite)
    flown = mission(name_or_path)
    plan = flown.plan
    assert flown.path is not None  # only a TOML file has a plan
    target = _target_folder(flown.path, folder)
    new_seed = None if not isinstance(plan, FlightPlan) or seed in {None, plan.seed} else seed
    check_flown(flown, new_seed, target, overwrite)
    flight = fly(plan, seed, progress, cancelled)
    return add_flown(
        flown, flight.recording, seed=new_seed, ending=flight.ending, folder=target, overwrite=overwrite
    )


def _is_motion(path: Path) -> bool:
    from lab.missions.motion_file import is_motion_file  # noqa: PLC0415 - SciPy, for those who need it

    try:
        with path.open("rb") as file:
            return is_motion_file(file.read(2**12))
    except (OSError, ValueError):
        return False


def _move_file(path: Path, folder: str | os.PathLike[str] | None, overwrite: bool) -> Mission:
    """Carry out a motion definition csv and add it as a mission."""
    from lab.missions.motion_commands import move  # noqa: PLC0415 - SciPy, for those who need it
    from lab.missions.motion_file import read_motion_file  # noqa: PLC0415

    plan = read_motion_file(path)
    motion = move(plan)
    hidden = ", ".join(f"{start:.6g} to {end:.6g} s" for start, end in motion.without_gps)
    return add_mission(
        motion.recording,
        suggested_name(path.stem),
        title=path.stem,
        description=f"The file says there is no GPS from {hidden}: sensors.gps.outages." if hidden else "",
        origin=f"Commands of {path.name}, a motion definition of gnss-ins-sim, carried out by the lab.",
        tags=("commands",),
        flight=plan.to_dict(),
        folder=folder,
        overwrite=overwrite,
    )


def _target_folder(source: Path, folder: str | os.PathLike[str] | None) -> Path:
    if folder is not None:
        return Path(folder)
    return own_folder() if source.parent.resolve() == shipped_folder().resolve() else source.parent


def _check(seen: Instruments, pilot: Pilot, now_ms: int) -> str:
    """Return why the flight ends here, or nothing."""
    where = f"{now_ms / 1000:.2f} s into the flight"
    if not math.isfinite(seen.height + seen.airspeed + seen.pitch + seen.roll + seen.heading):
        return f"the simulation broke down {where}: its state is not finite"
    stuck = pilot.stuck(now_ms / 1000, seen)
    if stuck:
        return (
            f"the aeroplane cannot do manoeuvre {pilot.manoeuvre}: {where} it came no nearer for "
            f"{PATIENCE:g} s ({stuck}); ask for less height, airspeed or bank, or calmer air"
        )
    if not pilot.airborne and abs(seen.roll) > _MOST_ROLL_ON_GROUND:
        return f"the aeroplane turned over on the runway {where}; ask for less wind across it"
    lost = _lost(seen, pilot) if pilot.airborne else ""
    if not lost:
        return ""
    return (
        f"the aeroplane {lost} {where} (airspeed {seen.airspeed:.1f} m/s) during manoeuvre "
        f"{pilot.manoeuvre}; ask for less bank, less rate of climb or calmer air"
    )


def _lost(seen: Instruments, pilot: Pilot) -> str:
    if seen.alpha > pilot.aircraft.stall_alpha or seen.airspeed < pilot.aircraft.stall_airspeed:
        return "stalled"
    if seen.on_ground or seen.height < 0:
        return "touched the ground"
    out = abs(seen.roll) > math.radians(75) or abs(seen.pitch) > math.radians(45)
    return "was out of control" if out else ""


def _recording(samples: np.ndarray) -> Recording:
    return Recording(
        time=np.arange(len(samples)) * SAMPLE_MS / 1000,
        latitude=samples[:, 0],
        longitude=samples[:, 1],
        height=samples[:, 2],
        velocity_n=samples[:, 3:6],
        euler=samples[:, 6:9],
        airspeed=samples[:, 9],
        alpha=samples[:, 10],
        beta=samples[:, 11],
    )
