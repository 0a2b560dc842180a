"""Comparison: a data set, navigated by each program under its protocol: figures, and what they rest on."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

import lab
from lab.analysis.cross_checks import LARGEST_PART, SETTLING
from lab.analysis.identification.renavigation import Subject, subject
from lab.analysis.identification.withheld import innovations_of_withheld
from lab.base.arrays import Flags, FloatArray
from lab.base.files.file_content import check_file
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.data.files.sensor_log_csv import log_files
from lab.data.log.auxiliary_data import Reference
from lab.data.log.sensor_log import SensorLog
from lab.experiment.ensembles.log_outages import Indices, mask_withheld, outage_turns
from lab.experiment.experiment import Experiment
from lab.experiment.scoreboard.adapters import ADAPTERS
from lab.experiment.scoreboard.opponents import OPPONENTS, Given, Navigated, installed
from lab.experiment.scoreboard.registry import LAB, PROGRAMS, DataSet
from lab.missions.flight_import import prepare_import, read_log
from lab.missions.library import add_log
from lab.motion.frames import ecef
from lab.motion.frames.displacement import displacement
from lab.motion.frames.rotation import C_nb_from_euler
from lab.navigation.checks import DivergedError
from lab.run.log_reference import interpolate_reference
from lab.run.run import Run

STATISTICS = {
    "horizontal_rms_m": "horizontal, rms",
    "horizontal_median_m": "horizontal, median",
    "horizontal_worst_m": "horizontal, largest",
    "three_d_rms_m": "3-D, rms",
    "worst_north_m": "north, largest",
    "worst_east_m": "east, largest",
    "worst_down_m": "down, largest",
}
"""The figures of a row [m], and what they are."""
RUN, MISSING, REFUSED, AWAITED = "run", "not installed", "refused", "data not at hand"
"""Outcomes of a row."""
_ROUNDING = 1e-9  # of time stamps [s]


class Row(NamedTuple):
    """What a program did with a data set.

    Attributes
    ----------
    data, program : str
        Name of the set and of the program.
    outcome : str
        "run", "not installed", "refused" or "data not at hand".
    reason : str
        Why there are no figures, or what must be known with them.
    version, date : str
        Version of the program, and the day.
    outages : int
        Number of outages; 0 if nothing is withheld.
    figures : mapping of str to float
        Errors, by `STATISTICS`.
    processor_s, log_s : float
        Time of the processor for all turns, and what was navigated in it [s].
    files : mapping of str to str
        SHA-256 of the files.
    checked : str
        With what these were compared: "registered" ones, those of the "first result", or "nothing".
    settings : str
        What the program assumed, in words.
    """

    data: str
    program: str
    outcome: str
    reason: str = ""
    version: str = ""
    date: str = ""
    outages: int = 0
    figures: Mapping[str, float] = {}
    processor_s: float = 0.0
    log_s: float = 0.0
    files: Mapping[str, str] = {}
    checked: str = ""
    settings: str = ""


def find_folder(about: DataSet, data: Path, *, alone: bool = False) -> Path | None:
    """Return the folder of a set in a folder, which is one of its name; None if there is none.

    Parameters
    ----------
    about, data
        The set, and the folder.
    alone
        Whether no other set is asked for: the folder itself may then be that of the set, whatever its name.
    """
    if (data / about.name).is_dir():
        return data / about.name
    if data.resolve().name == about.name:
        return data
    is_own = alone and any(
        path.name == "processed_log" or _is_read(about, path, data) for path in data.iterdir()
    )
    return data if is_own else None


def checked_files(
    about: DataSet, folder: Path, known: Mapping[str, str] | None = None
) -> tuple[dict[str, str], str]:
    """Return the SHA-256 of the files of a folder that are read, and with what they were compared.

    Parameters
    ----------
    about, folder
        The set, and its folder.
    known
        SHA-256 of files of an earlier result, for a set whose registry has none.

    Raises
    ------
    MissionError
        If a file is missing, or is another one.
    """
    # The registered files of a log are its csv; a set in its published layout has others.
    expected = dict(about.files) if _is_log(folder) or about.layout in ("log", "flight") else {}
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and _is_read(about, path, folder))
    if not paths:
        raise MissionError(f"{folder}: holds no file of {about.name}; {describe_source(about)}")
    needed = set(expected) or ({"imu.csv", "gnss.csv"} if _is_log(folder) else set())
    missing = sorted(needed - {path.name for path in paths})
    if missing:
        raise MissionError(f"{folder}: {missing[0]} is missing; {describe_source(about)}")
    found, compared = {}, set()
    for path in paths:
        check_file(path, MAX_BYTES)
        name = path.relative_to(folder).as_posix()
        with path.open("rb") as file:
            found[name] = hashlib.file_digest(file, "sha256").hexdigest()
        wanted = expected.get(name) or (known or {}).get(name)
        compared |= {name} if wanted else set()
        if wanted and wanted != found[name]:
            raise MissionError(
                f"{path}: is another file: its SHA-256 begins with {found[name][:8]}; accepted is "
                f"{wanted[:8]}…; {describe_source(about)}"
            )
    return found, "nothing" if compared < found.keys() else "registered" if expected else "first result"


def describe_source(about: DataSet) -> str:
    """Return where a set is published, in words."""
    return f"it is published at {about.source} ({about.licence}); nothing is fetched"


def _is_log(folder: Path) -> bool:
    """Return whether a folder has a csv file of a sensor log, though others may be missing."""
    return any((folder / name).is_file() for name in ("imu.csv", "gnss.csv"))


def _is_read(about: DataSet, path: Path, folder: Path) -> bool:
    if _is_log(folder):
        return path.parent == folder and path.name in ("imu.csv", "gnss.csv", "ref.csv")
    if about.layout == "flight":
        return path.name in about.files
    if about.layout == "navego":
        return path.name in {file for file, _ in about.structures.values()}
    if about.layout == "comma2k19":
        return path.relative_to(folder).match(_SEGMENT) or path.parent.name == "global_pose"
    return path.parent == folder and any(path.match(pattern) for pattern in _PATTERNS[about.layout])


_SEGMENT = "processed_log/*/*/*"
"""The arrays of a segment of comma2k19 that are read are among these."""
_PATTERNS = {
    "log": ("imu.csv", "gnss.csv", "ref.csv"),
    "tables": ("*.csv", "*.txt", "*.nav", "*.bin"),
    "gnss-imu": ("imu_*.csv", "imu_*.tag", "gnss_*.pos"),
    "nclt": ("ms25.csv", "gps.csv", "groundtruth*.csv"),
}
"""Names of the files of each layout in the folder of a set."""


def read(about: DataSet, folder: Path) -> SensorLog:
    """Return the sensor log of a set, from its own files or from the csv of a sensor log.

    Raises
    ------
    MissionError
        If the files are damaged, or are those of something else.
    """
    if _is_log(folder):
        files = log_files(folder)
        return _add_registry_values(replace(files, vehicle=files.vehicle or about.vehicle).read(), about)
    if about.layout == "tables":
        paths = sorted(path for path in folder.iterdir() if path.is_file() and _is_read(about, path, folder))
        return _add_registry_values(read_log(paths, axes=about.axes, vehicle=about.vehicle), about)
    if about.layout not in ADAPTERS:
        raise MissionError(f"{folder}: has no imu.csv and gnss.csv; {describe_source(about)}")
    return ADAPTERS[about.layout](folder, about)


def _add_registry_values(log: SensorLog, about: DataSet) -> SensorLog:
    """Return a log with the lever arm and the latency of the registry."""
    gnss = replace(log.gnss, lever_arm=np.array(about.lever_arm_m), latency=about.latency_s)
    return replace(log, gnss=gnss)


def experiment_of(about: DataSet, folder: Path, library: Path) -> Experiment:
    """Return the experiment on a set, which is converted into a library.

    Parameters
    ----------
    about, folder
        The set, and the folder of its files.
    library
        Folder for the missions that are made.

    Raises
    ------
    MissionError
        As of `read`.
    """
    if about.layout == "flight":
        flight = prepare_import([folder / name for name in about.files])
        made = flight.add(about.name, folder=library)
    else:
        made = add_log(read(about, folder), about.name, title=about.title, folder=library)
    assert made.path is not None  # of a mission in a folder
    found = Experiment(mission=str(made.path))
    found.update(about.settings)
    return found


def compare(
    about: DataSet,
    folder: Path,
    library: Path,
    progress: Progress | None = None,
    known: Mapping[str, str] | None = None,
) -> list[Row]:
    """Return a row for each program; one that fails or is not installed has a row that says so.

    Parameters
    ----------
    about, folder, library
        As of `experiment_of`.
    progress
        Called with a sentence about the current work and the fraction done, from 0 to 1.
    known
        As of `checked_files`.

    Raises
    ------
    MissionError
        If the files are missing, other ones or damaged.
    ValueError
        If the protocol does not fit into the set.
    """

    def tell(words: str, part: float) -> None:
        if progress is not None:
            progress(f"{about.name}: {words}", part)

    tell("checking and converting", 0.0)
    files, checked = checked_files(about, folder, known)
    experiment = experiment_of(about, folder, library)
    run = experiment.run()
    match = _Match.of(about, run)
    rows = []
    for number, program in enumerate(PROGRAMS):
        tell(program, (1 + number) / (1 + len(PROGRAMS)))
        row = match.row(program)
        rows.append(row._replace(files=files, checked=checked, date=datetime.now(UTC).date().isoformat()))
    return rows


class _Match(NamedTuple):
    """A set ready to be navigated: the run of our filter, the outages, and the reference at the fixes."""

    about: DataSet
    run: Run
    again: Subject
    turns: list[tuple[int, list[Indices]]]

    @classmethod
    def of(cls, about: DataSet, run: Run) -> _Match:
        again, protocol = subject(run), about.protocol
        if not protocol.seconds:
            return cls(about, run, again, [])
        first, last = again.span
        start = first + min(SETTLING, LARGEST_PART * (last - first))
        if protocol.first_s is not None:
            start = float(again.stamps[0]) + protocol.first_s
            last = float(again.stamps[-1]) - protocol.last_s
        turns = outage_turns(again.stamps, start, last, protocol.seconds, protocol.turns)
        if not turns:
            raise ValueError(
                f"{about.name}: no outage of {protocol.seconds:g} s fits into {last - first:.0f} s; "
                f"accepted are at least {start - first + protocol.seconds:.0f} s"
            )
        return cls(about, run, again, turns)

    def row(self, program: str) -> Row:
        """Return the row of a program."""
        found = Row(self.about.name, program, RUN, version=lab.__version__ if program == LAB else "")
        if program != LAB:
            found = found._replace(version=installed(program))
            if not found.version:
                return found._replace(outcome=MISSING, reason=f"pip install {program}")
        try:
            errors, seconds = self._errors_of_lab() if program == LAB else self._errors_of_program(program)
        except (SettingError, DivergedError, ValueError, ArithmeticError, RuntimeError) as error:
            return found._replace(outcome=REFUSED, reason=f"{type(error).__name__}: {error}")
        first, last = self.again.span
        count = sum(len(withheld) for _, withheld in self.turns)
        known = errors[np.isfinite(errors).all(axis=1)]
        if not known.size:
            return found._replace(
                outcome=REFUSED, reason="its positions are not finite, or nothing is known there"
            )
        return found._replace(
            outages=count,
            figures=figures(known),
            processor_s=seconds,
            log_s=(last - first) * max(1, len(self.turns)),
            settings=_ASSUMED[program],
            reason=_NOTES.get(program, ""),
        )

    def _errors_of_lab(self) -> tuple[FloatArray, float]:
        """Return errors (k, 3) north, east, down of our filter [m], and seconds of the processor."""
        nothing: Flags = np.zeros(self.again.stamps.size, dtype=np.bool_)
        if not self.turns:
            seconds = _seconds(lambda: self.again.navigate(self.run.experiment, nothing))
            arrays = self.run.solution_arrays
            return self._errors_of_whole_run(Navigated(arrays.position, arrays.q_nb)), seconds
        errors, seconds = [], 0.0
        for _, withheld in self.turns:
            mask = mask_withheld(self.again.stamps, withheld)
            began = time.process_time()
            seen = innovations_of_withheld(self.again, self.run.experiment, mask)
            seconds += time.process_time() - began
            errors.append(seen.innovation[[rows[-1] for rows in withheld], :3])
        return self._from_reference(np.concatenate(errors)), seconds

    def _errors_of_program(self, program: str) -> tuple[FloatArray, float]:
        """Return the same of another program."""
        given = Given.of(self.run)
        rows = np.searchsorted(self._validity, given.fixes.time - _ROUNDING)
        errors, seconds = [], 0.0
        masks = [mask_withheld(self.again.stamps, withheld) for _, withheld in self.turns]
        for number, mask in enumerate(masks or [np.zeros(self.again.stamps.size, dtype=np.bool_)]):
            navigate = OPPONENTS[program](given, mask[rows])
            began = time.process_time()
            path = navigate()
            seconds += time.process_time() - began
            if not self.turns:
                return self._errors_of_whole_run(path), seconds
            last = np.array([withheld[-1] for withheld in self.turns[number][1]])
            at = np.searchsorted(rows, last)
            there = path.antenna(given.imu.time, given.fixes.time[at], given.lever_arm)
            errors.append(displacement(given.fixes.position[at], there))
        return self._from_reference(np.concatenate(errors)), seconds

    @property
    def _validity(self) -> FloatArray:
        """Times of validity (m,) of all fixes [s]."""
        late = self.run.own_latency if self.run.recorded is None else self.run.recorded.log.gnss.latency
        return self.again.stamps - late

    @property
    def _reference(self) -> Reference:
        truth = self.run.truth_arrays
        if self.about.against == "truth":
            assert truth is not None  # of a simulated run
            return Reference(truth.time, truth.position, truth.velocity_n, truth.euler)
        reference = None if self.run.recorded is None else self.run.recorded.log.reference
        if reference is None:
            raise ValueError("the set has no reference, from which its protocol takes the errors")
        return reference

    def _from_reference(self, errors: FloatArray) -> FloatArray:
        """Return errors from the last withheld fixes as errors from what the protocol takes."""
        if self.about.against == "fixes":
            return errors
        last = np.array([rows[-1] for _, withheld in self.turns for rows in withheld])
        there = interpolate_reference(self._reference, self._validity[last])
        if there is None:
            raise ValueError("the reference has no rows at the ends of the outages")
        place, arm = there.position, self.run.belief.lever_arm
        if self.about.reference_at == "imu" and arm.any():
            C = ecef.axes(place[:, 0], place[:, 1]) @ C_nb_from_euler(there.euler)
            place = ecef.geodetic(ecef.position(place) + C @ arm)
        fixes = self._positions[last]
        return errors + displacement(place, fixes)

    @property
    def _positions(self) -> FloatArray:
        """Positions (m, 3) of all fixes."""
        return self.run.fixes.position if self.run.recorded is None else self.run.recorded.log.gnss.position

    def _errors_of_whole_run(self, path: Navigated) -> FloatArray:
        """Return the errors of a whole run at the samples, from the reference."""
        times, arm = self.run.time, self.run.belief.lever_arm
        there = interpolate_reference(self._reference, times)
        if there is None:
            raise ValueError("the reference has no rows during the IMU data")
        place = path.antenna(times, times, arm) if self.about.reference_at == "antenna" else path.position
        return displacement(there.position, place)


def _seconds(work: Callable[[], object]) -> float:
    """Return the seconds of the processor that some work takes."""
    began = time.process_time()
    work()
    return time.process_time() - began


def figures(errors: FloatArray) -> dict[str, float]:
    """Return the statistics of errors (k, 3) north, east, down [m]."""
    horizontal, size = np.hypot(errors[:, 0], errors[:, 1]), np.abs(errors)
    values = (
        np.sqrt(np.mean(horizontal**2)),
        np.median(horizontal),
        horizontal.max(),
        np.sqrt(np.mean(np.sum(errors**2, axis=1))),
        *size.max(axis=0),
    )
    return dict(zip(STATISTICS, map(float, values), strict=True))


_SHARED = "increments, fixes with their covariances, start with its σ, noise and drive of the biases"
_ASSUMED = {
    LAB: "settings of the set, otherwise defaults, among them updates of the gyro biases at rest; 15 states",
    "python-ins": f"{_SHARED} of our filter; run_feedback_filter, otherwise defaults; 15 states",
    "sidereon": f"{_SHARED} of our filter, without the gyro biases; InertialFilter, EKF, update_loose, "
    "otherwise defaults; 15 states",
}
"""What each program assumes."""
_NOTES = {
    "sidereon": "gyro biases stay those of the start: if it estimates them, 3.0.4 diverges, also at rest",
}
"""What must be known with the figures of a program."""


def rows_not_run(about: DataSet) -> list[Row]:
    """Return rows of a set that never ran."""
    return [Row(about.name, program, AWAITED) for program in PROGRAMS]
