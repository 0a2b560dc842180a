"""Place matrix: flights where frames and angles are difficult, with every model; NEES, or what is refused.

Run it with ``python -m tests.benchmarks.place_matrix [words in names of flights or settings ...]``. Each cell
is the mean NEES per state of four runs; a refusal is given by the setting that its message begins with.
"budget" and "observability" are asked of the first run.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from lab.experiment import CACHE, Experiment
from lab.recordings.flight_csv import write_flight_csv
from lab.recordings.recording import Recording
from lab.result import Result

SEEDS = 4
STEP = 0.05
"""Time between the rows of the recordings [s]."""
RATE = 50.0
"""IMU rate [Hz]: enough for these smooth flights."""
MORE = {
    "sensors.barometer.fitted": True,
    "sensors.heading.fitted": True,
    "navigator.estimate_bias_drift": True,
    "navigator.estimate_lever_arm": True,
    "sensors.gyro.instability": 30.0,
}
SETTINGS: dict[str, dict[str, Any]] = {
    **{
        f"{model}, north-slaved": {"navigator.model": model}
        for model in ("phi", "psi", "invariant", "nonlinear")
    },
    **{
        f"{model}, wander": {"navigator.model": model, "navigator.mechanization": "wander azimuth"}
        for model in ("phi", "psi", "invariant", "nonlinear")
    },
    "phi, wander, smoother": {"navigator.mechanization": "wander azimuth", "navigator.smoother": True},
    "phi, wander, more": {"navigator.mechanization": "wander azimuth"} | MORE,
    "invariant, wander, more": {"navigator.mechanization": "wander azimuth", "navigator.model": "invariant"}
    | MORE,
    "phi, wander, smoother, more": {"navigator.mechanization": "wander azimuth", "navigator.smoother": True}
    | MORE,
    "phi, north-slaved, more": dict(MORE),
}


def moved(latitude: float, longitude: float) -> Recording:
    """Return a flight with turns and climbs to the north-east, half of it on each side of a place [°]."""
    t = np.arange(0.0, 120.0 + STEP / 2, STEP)
    course = np.radians(45) + 0.6 * np.sin(2 * np.pi * t / 40)
    velocity = np.stack((70 * np.cos(course), 70 * np.sin(course), 3 * np.sin(0.1 * t)), axis=-1)
    way = np.concatenate((np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * STEP, axis=0)))
    way -= way[t.size // 2]
    north, east, down = way.T
    euler = np.stack((0.4 * np.sin(2 * np.pi * t / 40), 0.05 * np.sin(0.1 * t), course), axis=-1)
    place = np.radians(latitude) + north / 6.36e6
    around = np.radians(longitude) + east / (6.378e6 * np.cos(place))
    return Recording(t, place, (around + np.pi) % (2 * np.pi) - np.pi, 1000 - down, velocity, euler)


def looping() -> Recording:
    """Return a flight with three loops: the pitch passes ±90°."""
    t = np.arange(0.0, 150.0 + STEP / 2, STEP)
    angle = np.radians(10.0) * np.clip(t - 20.0, 0.0, 108.0)
    # The rate of the pitch begins and ends within a second.
    angle = np.convolve(np.pad(angle, 20, mode="edge"), np.full(41, 1 / 41), mode="valid")
    velocity = np.stack((50 * np.cos(angle), np.zeros_like(t), -50 * np.sin(angle)), axis=-1)
    way = np.concatenate((np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * STEP, axis=0)))
    over = np.where(np.cos(angle) < 0, np.pi, 0.0)
    latitude = 0.7 + way[:, 0] / 6.36e6
    euler = np.stack((over, np.arcsin(np.sin(angle)), over), axis=-1)
    return Recording(t, latitude, np.full_like(t, 0.2), 2000 - way[:, 2], velocity, euler)


def flights() -> dict[str, Recording]:
    """Return the flights by name."""
    sys.path.insert(0, str(Path(__file__).parent.parent))
    from polar_flights import FLIGHTS, over_the_pole

    polar = {
        name: over_the_pole(**FLIGHTS[name]) for name in FLIGHTS if "straight" in name or "curve over" in name
    }
    return polar | {
        "equator": moved(0.0, 30.0),
        "date line": moved(51.0, 180.0),
        "equator at the date line": moved(0.0, -180.0),
        "loops, 90° pitch": looping(),
    }


def cell(path: Path, settings: dict[str, Any]) -> str:
    """Return NEES per state of a flight with some settings, or what is refused, and which analyses work."""
    values = []
    first: Result | None = None
    for seed in range(SEEDS):
        experiment = Experiment(mission=str(path), seed=seed)
        experiment.set("trajectory.imu_rate", RATE)
        for name, value in settings.items():
            experiment.set(name, value)
        try:
            result = experiment.run()
        except ValueError as error:
            return f"refused: {str(error).split(':')[0][:60]}"
        first = first or result
        consistency = result.consistency["nees"]
        values.append(float(consistency.mean()) / float(consistency.attrs["degrees"]))
    assert first is not None
    words = [f"NEES {np.mean(values):5.2f}"]
    for name in ("budget", "observability", "verdict"):
        try:
            getattr(first, name)
            words.append(f"{name} yes")
        except ValueError as error:
            words.append(f"{name} no ({str(error).split(':')[0][:40]})")
    CACHE.clear()
    return ", ".join(words)


def main(words: list[str]) -> None:
    """Print the matrix."""
    with tempfile.TemporaryDirectory() as folder:
        for place, (flight, recording) in enumerate(flights().items()):
            path = Path(folder) / f"flight{place}.csv"
            write_flight_csv(path, recording)
            for name, settings in SETTINGS.items():
                if all(word in f"{flight} {name}" for word in words):
                    print(f"{flight:32} {name:32} {cell(path, settings)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
