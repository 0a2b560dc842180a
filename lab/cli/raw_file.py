"""Raw file: where ``ins-lab live record`` keeps the bytes; nothing of it stays if none came."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from lab.cli.app import CommandError, working

if TYPE_CHECKING:
    from lab.data.log.sensor_log import SensorLog
    from lab.data.streams.source import Source
    from lab.missions.mission import Mission


class RawFile:
    """The raw recording of a mission.

    Attributes
    ----------
    path : pathlib.Path
        The file.

    Parameters
    ----------
    folder
        Where it is kept; it is made if it is not there.
    name
        Name of the mission.
    """

    def __init__(self, folder: Path, name: str) -> None:
        from lab.data.streams.raw_recording import SUFFIX  # noqa: PLC0415 - help does not need it

        self.path = folder / f"{name}{SUFFIX}"
        self._made: list[Path] = []

    def begin(self, source: Source) -> None:
        """Record a source into it.

        Raises
        ------
        CommandError
            If the folder cannot be made.
        RecordingError
            If the file exists, or cannot be made.
        """
        folder = self.path.parent
        self._made = [one for one in (folder, *folder.parents) if not one.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CommandError(f"{folder}: cannot be made: {error.strerror or error}") from error
        try:
            source.record(self.path)
        except OSError:
            self._remove_folders()
            raise

    def as_mission(
        self, name: str, lever_arm: tuple[float, float, float], title: str, folder: Path | None
    ) -> tuple[SensorLog, Mission]:
        """Return the recording as a log, and its mission; the recording stays whatever happens.

        Parameters
        ----------
        name, title
            Of the mission.
        lever_arm
            From the IMU to the antenna, forward, right, down [m].
        folder
            Where it is kept; None for the user's own missions.

        Raises
        ------
        CommandError
            If it cannot be made.
        """
        from lab.data.streams.raw_recording import RecordingError  # noqa: PLC0415 - help does not need it
        from lab.data.streams.recorded_log import log_of_recording  # noqa: PLC0415 - help does not need it
        from lab.missions.library import add_log  # noqa: PLC0415 - help does not need it

        with working(str(self.path)):
            try:
                log = log_of_recording(self.path, lever_arm=lever_arm)
                return log, add_log(log, name, title=title, folder=folder)
            except (RecordingError, ValueError) as error:
                raise CommandError(f"{error}. The recording stays in {self.path}") from error
            except KeyboardInterrupt:
                again = f'ins-lab live record "replay:{self.path}?speed=max" NAME'
                print(
                    f"ins-lab: No mission was made. The recording stays; make one with: {again}",
                    file=sys.stderr,
                )
                raise

    def discard(self) -> None:
        """Delete the file, and the folders that were made for it."""
        self.path.unlink(missing_ok=True)
        self._remove_folders()

    def _remove_folders(self) -> None:
        for one in self._made:
            try:
                one.rmdir()
            except OSError:  # another program has put something there meanwhile
                return
