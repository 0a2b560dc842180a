"""Which reader takes a file, and what a person is told where none does."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from lab.data.formats import MAX_FILES, READERS, read_raw, reader_of
from lab.missions import MissionError


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "there is no such file"),
        (b"", "the file is empty"),
        (b"Dear diary,\ntoday we flew.\n", "its format is unknown. Accepted: "),
        (b"PK\x03\x04 what a zip archive begins with", "It is a zip archive: unpack it first"),
        (gzip.compress(b"nothing of use", mtime=0)[:-6], "cannot be read"),
    ],
)
def test_what_is_no_recording_is_named_once(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "flight.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MissionError) as refused:
        reader_of(path)
    assert words in str(refused.value)
    assert str(refused.value).count(str(path)) == 1
    if "Accepted" in words:
        assert all(reader.name in str(refused.value) for reader in READERS)


def test_files_of_several_flights_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="0 files given"):
        read_raw([])
    with pytest.raises(MissionError, match=f"accepted are 1 to {MAX_FILES}"):
        read_raw([tmp_path / str(number) for number in range(MAX_FILES + 1)])
