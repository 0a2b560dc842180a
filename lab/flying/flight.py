"""Flight: a plan flown, to its end or as far as it went, and recorded as a `Recording`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lab.base.files.mission_error import MissionError
from lab.flying.flight_plan import FlightPlan
from lab.flying.pilot import PATIENCE, Pilot
from lab.flying.simulated_aircraft import STEP_MS, Instruments, SimulatedAircraft
from lab.motion.recordings.recording import Recording

if TYPE_CHECKING:
    from lab.flying.flight_plan import Plan
    from lab.flying.motion_commands import MotionPlan
    from lab.flying.waypoints import WaypointPlan

SAMPLE_MS = 55
"""Time between two samples of the record [ms]."""
PILOT_MS = 5
"""Time between two readings of the instruments by the pilot [ms]."""

_MAX_ROLL_ON_GROUND = math.radians(30.0)
"""Roll beyond which an aircraft on the ground has turned over [rad]: the wheels of one side have left the
ground."""
_MAX_ROLL, _MAX_PITCH = math.radians(75.0), math.radians(45.0)
"""Attitude beyond which the pilot has lost the aircraft [rad]: plans ask for banks of up to 60°."""

SHORTEST = 2.0
"""Shortest flight that is kept [s]: 37 samples, by which curves can be drawn and judged."""
FEWEST = math.ceil(SHORTEST * 1000 / SAMPLE_MS)
"""Fewest samples of a flight that is kept."""


@dataclass(frozen=True, eq=False)
class Flight:
    """The result of flying a plan.

    Attributes
    ----------
    recording : Recording
        The flown motion: one sample every 55 ms of simulator time.
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
    """Fly a plan and return its recording and, if it ended early, the reason.

    The same plan and seed give the same bits on the same machine. The last sample is the first one not before
    the plan's duration, or the last one before the flight ended. Waypoints and motion commands need no
    simulator, and are carried out at once.

    Parameters
    ----------
    plan
        The plan.
    seed
        Seed of the turbulence; the plan's own by default.
    progress
        Called about every second of flight with the fraction flown, 0 to 1.
    cancelled
        Asked at every sample whether to end the flight here.

    Raises
    ------
    MissionError
        If JSBSim is missing, the flight ended before `SHORTEST` seconds were flown, the path or the motion
        cannot be carried out, or a seed is given for them, which have no turbulence.
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
    if flown < FEWEST:
        raise MissionError(ending or f"a flight of {plan.duration_s:g} s is too short")
    if progress is not None and flown == count:
        progress(1.0)
    return Flight(_recording(samples[:flown]), ending)


def _carry_out(
    plan: WaypointPlan | MotionPlan, seed: int | None, progress: Callable[[float], None] | None
) -> Flight:
    from lab.flying.motion_commands import MotionPlan, move  # noqa: PLC0415 - SciPy, for those who need it
    from lab.flying.waypoints import travel  # noqa: PLC0415

    refuse_seed(seed)
    recording = move(plan).recording if isinstance(plan, MotionPlan) else travel(plan)
    if progress is not None:
        progress(1.0)
    return Flight(recording)


def refuse_seed(seed: int | None) -> None:
    """Refuse a seed for a flight without turbulence.

    Raises
    ------
    MissionError
        If one is given.
    """
    if seed is not None:
        raise MissionError(f"seed = {seed}: waypoints and commands have no turbulence; leave it out")


def _fly_samples(
    aeroplane: SimulatedAircraft,
    pilot: Pilot,
    samples: np.ndarray,
    progress: Callable[[float], None] | None,
    cancelled: Callable[[], bool] | None,
) -> tuple[int, str]:
    """Fill the samples; return the number of flown samples, and the reason of an early end."""
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


def _check(seen: Instruments, pilot: Pilot, now_ms: int) -> str:
    """Return why the flight ends here, or nothing."""
    where = f"{now_ms / 1000:.2f} s into the flight"
    if not math.isfinite(seen.height + seen.airspeed + seen.pitch + seen.roll + seen.heading):
        return f"the simulation broke down {where}: its state is not finite"
    stuck = pilot.find_missed_target(now_ms / 1000, seen)
    if stuck:
        return (
            f"the aeroplane cannot do manoeuvre {pilot.manoeuvre}: {where} it came no nearer for "
            f"{PATIENCE:g} s ({stuck}); ask for less height, airspeed or bank, or calmer air"
        )
    if not pilot.airborne and abs(seen.roll) > _MAX_ROLL_ON_GROUND:
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
    out = abs(seen.roll) > _MAX_ROLL or abs(seen.pitch) > _MAX_PITCH
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
