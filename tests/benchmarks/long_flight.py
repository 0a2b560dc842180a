"""Long flight: a visit to a flight of hours, step by step, with the memory that each step takes.

``python -m tests.benchmarks.long_flight CASE [HOURS]`` prints, as a line of JSON for each step, its name, its
time [s], and the memory of the process during it and after it [bytes]. A case is one of `CASES`.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from lab import Experiment
from lab.missions import Recording, write_flight_csv

sys.path.append(str(Path(__file__).parents[1] / "dashboards"))

HOURS = 4.0
LEFT_OUT = os.environ.get("INS_LAB_TABS_LEFT_OUT", "").split(",")
"""Tabs that are not opened; such as those that take long on a slow machine."""
PATIENCE = 4 * 3600.0
"""Longest time that a tab may take [s]: beside other work, some take hours."""
RATE = 10.0
"""Rate of the recording [Hz]; the IMU has 200 Hz."""
STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def recording(hours: float) -> Recording:
    """Return racetracks at 60 m/s with climbs and descents, for some hours."""
    at = np.arange(round(hours * 3600 * RATE) + 1) / RATE
    turn = 2 * np.pi * at / 400.0
    radius = 60.0 * 400.0 / (2 * np.pi)
    climb = 10.0 * np.cos(3 * turn) * 3 * 2 * np.pi / 400.0
    return Recording(
        time=at,
        latitude=np.radians(45.0) + radius * np.sin(turn) / 6.367e6,
        longitude=radius * (1 - np.cos(turn)) / (6.389e6 * np.cos(np.radians(45.0))),
        height=300.0 + 10.0 * np.sin(3 * turn),
        velocity_n=np.column_stack((60.0 * np.cos(turn), 60.0 * np.sin(turn), -climb)),
        euler=np.column_stack((0 * at + 0.09, 0.02 * np.sin(turn), np.angle(np.exp(1j * turn)))),
    )


@contextmanager
def long_mission(hours: float) -> Iterator[str]:
    """Add a mission of some hours to those of the catalogue while this is open; give its name."""
    with tempfile.TemporaryDirectory() as folder:
        write_flight_csv(Path(folder) / "long.csv", recording(hours))
        (Path(folder) / "long.toml").write_text('title = "Hours of racetracks"\nrecording = "long.csv"\n')
        before = os.environ.get("INS_LAB_MISSIONS")
        os.environ["INS_LAB_MISSIONS"] = folder
        try:
            yield "long"
        finally:
            os.environ.pop("INS_LAB_MISSIONS")
            if before is not None:
                os.environ["INS_LAB_MISSIONS"] = before


def memory(name: str) -> int:
    """Return the memory of this process [bytes]: ``"VmHWM"``, the most since the reset, or ``"VmRSS"``."""
    return 1024 * int(STATUS.read_text().split(f"{name}:")[1].split()[0])


@contextmanager
def step(name: str) -> Iterator[None]:
    """Measure a step, and print it."""
    RESET.write_text("5")  # sets VmHWM to VmRSS
    begin = time.monotonic()
    yield
    row = {"step": name, "seconds": round(time.monotonic() - begin, 2)}
    print(json.dumps(row | {"peak": memory("VmHWM"), "after": memory("VmRSS")}), flush=True)


def experiment(mission: str, **settings: object) -> Experiment:
    """Return an experiment; settings have __ for the point."""
    made = Experiment(mission=mission)
    for path, value in settings.items():
        made.set(path.replace("__", "."), value)
    return made


def of_library(mission: str, **settings: object) -> None:
    """Run and judge the flight, as a script and the command line do."""
    with step("run"):
        result = experiment(mission, **settings).run()
    with step("summary"):
        _ = result.summary
    with step("verdict"):
        _ = result.verdict, result.innovation_verdict


def of_page(mission: str, **settings: object) -> None:
    """Open the page, choose the flight, move a slider twice, open every tab, and move the slider again."""
    import pytest
    from panel.io.state import set_curdoc
    from walking import TITLES, Walk, walking

    def settle(walk: Walk) -> None:
        session = walk.page.session
        while session._runs.busy or session._arrived is not None:
            walk.settle()
            time.sleep(0.01)
        walk.settle()
        assert not session.problem, session.problem
        assert walk.complaints() == []

    def change(walk: Walk, path: str, value: object) -> None:
        with set_curdoc(walk._document):
            assert walk.page.session.change(path, value), walk.page.session.problem
        settle(walk)

    with pytest.MonkeyPatch.context() as patch, walking(patch) as walk:
        patch.setattr("walking.PATIENCE", PATIENCE)
        with set_curdoc(walk._document):
            walk.page.session._open()
            walk.page.pages.draw()
        for path, value in settings.items():
            walk.page.session.experiment.set(path.replace("__", "."), value)
        with step("flight chosen"):
            change(walk, "mission", mission)
        for number in (1, 2):
            with step(f"slider moved, {number}"):
                change(walk, "sensors.gyro.noise_density", 0.01 + 0.001 * number)
        for title in (title for title in TITLES if title not in LEFT_OUT):
            with step(title):
                walk.open(title)
                settle(walk)
        walk.open("Verdict")
        with step("slider moved on Consistency"):
            change(walk, "sensors.gyro.noise_density", 0.02)


RICH = {
    "navigator__states": 21,
    "sensors__gyro__instability": 30,
    "sensors__accelerometer__instability": 0.1,
}
"""All states of the filter, and biases that drift."""
SMOOTHED = RICH | {"navigator__smoother": True}
CASES = {
    "run": (of_library, {}),
    "run of 21 states": (of_library, RICH),
    "run smoothed": (of_library, SMOOTHED),
    "page": (of_page, {}),
    "page of 21 states": (of_page, RICH),
    "page smoothed": (of_page, SMOOTHED),
}


def main() -> None:
    """Measure one case."""
    work, settings = CASES[sys.argv[1]]
    with long_mission(float(sys.argv[2]) if len(sys.argv) > 2 else HOURS) as mission:
        work(mission, **settings)


if __name__ == "__main__":
    main()
