"""Deleted files: files that were moved aside, until they are forgotten or brought back."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from lab.base.files.locks import folder_lock
from lab.base.files.mission_error import MissionError
from lab.base.files.temporary_files import temporary_folder


class DeletedFiles:
    """Files that were deleted together, as those of a mission, which may still be brought back.

    Parameters
    ----------
    name
        What they are, such as ``mission drive``.
    kept
        Where each file is now, and where it was.
    holding
        Holds the folder where they are; closed, the folder goes with what is in it.
    """

    def __init__(self, name: str, kept: Sequence[tuple[Path, Path]], holding: contextlib.ExitStack) -> None:
        self.name = name
        self._kept = tuple(kept)
        self._holding = holding

    @classmethod
    def taken(cls, name: str, within: Path, places: Sequence[Path]) -> DeletedFiles:
        """Move files aside, the first one first, into a folder within another one, on the same disk.

        Raises
        ------
        OSError
            If one cannot be moved; then all are where they were.
        """
        with contextlib.ExitStack() as holding:
            folder = holding.enter_context(temporary_folder(within))
            kept = [(folder / str(number), place) for number, place in enumerate(places)]
            try:
                for file, place in kept:
                    place.rename(file)
            except OSError:
                for file, place in kept:
                    if file.exists():
                        file.rename(place)
                raise
            return cls(name, kept, holding.pop_all())

    def restore(self) -> None:
        """Bring the files back.

        Raises
        ------
        MissionError
            If a file has taken the place of one of these, or the folder cannot be written.
        """
        if not self._kept:
            raise MissionError(f"{self.name}: its files are gone")
        folder = self._kept[0][0].parent.parent
        with file_errors_reported(folder), folder_lock(folder):
            for _, place in self._kept:
                if place.exists():
                    raise MissionError(f"{place}: not brought back, because another file is there now")
            for file, place in self._kept:
                place.parent.mkdir(exist_ok=True)
                file.rename(place)
        self.forget()

    def forget(self) -> None:
        """Delete the files for good."""
        self._kept = ()
        self._holding.close()


@contextlib.contextmanager
def file_errors_reported(folder: Path) -> Iterator[None]:
    """Raise errors of the file system as a `MissionError`."""
    try:
        yield
    except OSError as error:
        where = error.filename or folder
        raise MissionError(f"{where}: cannot be changed: {error.strerror or error}") from error
