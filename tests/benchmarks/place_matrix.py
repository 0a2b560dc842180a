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

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.motion.recordings.recording import Recording

SEEDS = 4
RATE = 50.0
"""IMU rate [Hz]: enough for these smooth flights."""
QUIET = {
    "sensors.gyro.noise_density": 0.005,
    "sensors.gyro.bias_sigma": 0.01,
    "sensors.accelerometer.bias_sigma": 0.2,
}
"""Sensors better than the default ones, with which a linear filter is consistent. On straight flights, the
default gyros leave a heading uncertain by 6°: NEES of linear filters is then up to 1.7 at any latitude."""
MORE = {
    "sensors.barometer.fitted": True,
    "sensors.heading.fitted": True,
    "sensors.airspeed.fitted": True,
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


def flights() -> dict[str, Recording]:
    """Return the flights by name."""
    sys.path.insert(0, str(Path(__file__).parent.parent))
    from place_flights import looping, moved
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
        for name, value in (QUIET | settings).items():
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
