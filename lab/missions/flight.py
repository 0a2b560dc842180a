"""Flight: a plan flown from the runway to its end and recorded as a `Recording`."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lab.missions.atomic_file import atomic_file
from lab.missions.catalogue import mission, own_folder, shipped_folder
from lab.missions.cessna import STEP_MS, Cessna, Instruments
from lab.missions.errors import MissionError
from lab.missions.flight_csv import write_flight_csv
from lab.missions.flight_plan import FlightPlan
from lab.missions.mission import Mission
from lab.missions.pilot import Pilot
from lab.missions.recording import Recording

SAMPLE_MS = 55
"""Time between two samples of the record [ms]."""
PILOT_MS = 5
"""Time between two looks of the pilot at the instruments [ms]."""

_STALL_ALPHA = math.radians(18.0)
_STALL_AIRSPEED = 22.0


def fly(
    plan: FlightPlan, seed: int | None = None, progress: Callable[[float], None] | None = None
) -> Recording:
    """Fly a plan and return its record: one sample every 55 ms of simulator time, from rest.

    The same plan and seed give the same bits on the same machine. The last sample is the first one not before
    the plan's duration.

    Parameters
    ----------
    plan
        What to fly.
    seed
        Seed of the turbulence; the plan's own by default.
    progress
        Called about every second of flight with the fraction flown, 0 to 1.

    Raises
    ------
    MissionError
        If JSBSim is missing, the aeroplane stalls, touches the ground or is lost, or the plan needs more time
        than it has.
    """
    cessna = Cessna(plan if seed is None else plan.with_seed(seed))
    pilot = Pilot(plan, PILOT_MS / 1000)
    count = math.ceil(round(plan.duration_s * 1000) / SAMPLE_MS) + 1
    samples = np.empty((count, 12))
    for now in range(0, (count - 1) * SAMPLE_MS + 1, STEP_MS):
        if now % PILOT_MS == 0:
            seen = cessna.instruments()
            _check(seen, pilot, now)
            cessna.move(pilot.fly(now / 1000, seen))
        if now % SAMPLE_MS == 0:
            samples[now // SAMPLE_MS] = cessna.sample()
            if progress is not None and now % (20 * SAMPLE_MS) == 0:
                progress(now / ((count - 1) * SAMPLE_MS))
        cessna.step()
    if not pilot.on_last_manoeuvre:
        raise MissionError(
            f"the flight of {plan.duration_s:g} s ended during manoeuvre {pilot.manoeuvre}: "
            "give duration_s more time or shorten the manoeuvres"
        )
    if progress is not None:
        progress(1.0)
    return _recording(samples)


def fly_mission(
    name_or_path: str | os.PathLike[str],
    *,
    seed: int | None = None,
    folder: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Mission:
    """Fly a mission's plan and write the mission: its TOML file and the new recording beside it.

    With the mission's own seed, the recording is the same, bit by bit.

    Parameters
    ----------
    name_or_path
        As for `mission`; the TOML file has a ``[flight]`` table, its recording need not exist yet.
    seed
        Seed of the turbulence, written into the new TOML file; the plan's own by default.
    folder
        Where to write; by default the user's own folder for a shipped mission, or else the mission's folder.
    overwrite
        True replaces an existing recording and TOML file of that name.
    progress
        Called about every second of flight with the fraction flown, 0 to 1.

    Returns
    -------
    Mission
        As written.

    Raises
    ------
    MissionError
        If files exist already and may not be replaced, or as for `fly`; nothing is written then.
    """
    flown = mission(name_or_path)
    plan, source = flown.plan, flown.path
    assert source is not None  # only a TOML file has a plan
    target = _target_folder(source, folder)
    toml, recording_path = target / source.name, target / flown.recording_path.name
    try:
        content = _toml_with_seed(source, None if seed in {None, plan.seed} else seed)
        same_toml = toml.is_file() and toml.read_bytes() == content
        _check_free([recording_path] if same_toml else [recording_path, toml], overwrite)
        recording = fly(plan, seed, progress)
        target.mkdir(parents=True, exist_ok=True)
        write_flight_csv(recording_path, recording)
        if not same_toml:
            with atomic_file(toml) as file:
                file.write(content)
    except OSError as error:
        raise MissionError(f"{target}: {error.strerror or error}") from error
    return mission(toml)


def _check_free(paths: list[Path], overwrite: bool) -> None:
    existing = [str(path) for path in paths if path.exists()]
    if existing and not overwrite:
        raise MissionError(
            f"{' and '.join(existing)} would be replaced: allow it with overwrite, or choose another folder"
        )


def _target_folder(source: Path, folder: str | os.PathLike[str] | None) -> Path:
    if folder is not None:
        return Path(folder)
    return own_folder() if source.parent.resolve() == shipped_folder().resolve() else source.parent


def _toml_with_seed(source: Path, seed: int | None) -> bytes:
    """Return a mission's TOML file, word by word unless another seed is to be written."""
    content = source.read_bytes()
    if seed is None:
        return content
    import tomli_w  # noqa: PLC0415 - rarely needed

    values = tomllib.loads(content.decode("utf-8-sig"))
    values["flight"]["seed"] = seed
    return tomli_w.dumps(values).encode()


def _check(seen: Instruments, pilot: Pilot, now_ms: int) -> None:
    where = f"{now_ms / 1000:.2f} s into the flight"
    if not math.isfinite(seen.height + seen.airspeed + seen.pitch + seen.roll + seen.heading):
        raise MissionError(f"the simulation broke down {where}: its state is not finite")
    if not pilot.airborne:
        return
    during = f"during manoeuvre {pilot.manoeuvre}; ask for less bank, less rate of climb or calmer air"
    if seen.alpha > _STALL_ALPHA or seen.airspeed < _STALL_AIRSPEED:
        raise MissionError(f"the aeroplane stalled {where} (airspeed {seen.airspeed:.1f} m/s) {during}")
    if seen.on_ground or seen.height < 0:
        raise MissionError(f"the aeroplane touched the ground {where} {during}")
    if abs(seen.roll) > math.radians(75) or abs(seen.pitch) > math.radians(45):
        raise MissionError(f"the aeroplane was out of control {where} {during}")


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
