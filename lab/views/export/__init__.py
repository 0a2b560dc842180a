"""Export: flights as files for other programs: maps, programs that evaluate trajectories, our own flight csv.

>>> from lab import Experiment, export_track
>>> export_track(Experiment(mission="montreal").run(), "montreal.kml")
"""

from __future__ import annotations

import os
from pathlib import Path

from lab.base.files.atomic_file import atomic_file
from lab.experiment.result import Result
from lab.missions import Mission, write_flight_csv
from lab.run.provenance import facts_block, facts_of_mission
from lab.views.export import gpx, kml
from lab.views.export.tracks import Tracks, make_recording, make_tracks
from lab.views.export.trajectory_files import WRITERS, make_trajectory

TEXTS = {".kml": kml.text, ".gpx": gpx.text}
ENDINGS = (".kml", ".gpx", ".csv", ".csv.gz", *WRITERS)
"""Endings of the files that can be written."""

__all__ = ["ENDINGS", "Tracks", "export_track", "make_tracks"]


def export_track(source: Result | Mission, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write where a flight was into a file, of the kind its ending says; it appears whole or not at all.

    All but SBET, which has no room for it, say what made them: `lab.open_result` reads that. In files of
    columns, it stands in comments before them.

    Parameters
    ----------
    source
        A run: its true path, its estimated path and its GPS fixes. Or a mission: its path as recorded, of a
        log its reference and its fixes.
    path
        Ends with ``.kml`` or ``.gpx``; or with ``.csv`` or ``.csv.gz`` for a flight csv, which holds one path
        with its attitude: the estimated one of a run, the recorded one of a mission. That path is also in
        files that end with ``.tum`` (evo), ``.pos`` (RTKLIB), ``.sbet`` or ``.out`` (SBET), and with its σ in
        ``.solution.csv`` and ``.parquet``.
    overwrite
        True replaces a file that is there.

    Raises
    ------
    FileExistsError
        If the file exists and `overwrite` is not given.
    MissionError
        If a mission cannot be read, or the flight csv of a log, whose attitude has gaps, is requested; or if
        parquet is, and pyarrow is not installed.
    ValueError
        For another ending.
    OSError
        If the file cannot be written.
    """
    path = Path(path)
    if not path.name.lower().endswith(ENDINGS):
        raise ValueError(f"{path}: accepted are names ending in {', '.join(ENDINGS)}")
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists already; nothing was written. overwrite=True replaces it")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: there is no folder {path.parent}")
    ending = next((one for one in (*WRITERS, *TEXTS) if path.name.lower().endswith(one)), "")
    facts = source.facts if isinstance(source, Result) else facts_of_mission(source)
    if not ending:
        write_flight_csv(path, make_recording(source), facts_block(facts, "# ", short=True))
        return
    blocks = (
        [TEXTS[ending](make_tracks(source)).encode()]
        if ending in TEXTS
        else WRITERS[ending](make_trajectory(source), facts)
    )
    with atomic_file(path) as file:
        for block in blocks:
            file.write(block)
