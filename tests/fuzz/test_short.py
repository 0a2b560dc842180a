"""The short form of ``make fuzz``: each reader, some hundred hostile files, the same ones every time."""

from __future__ import annotations

import gzip
import os
import zlib

import numpy as np
import pytest
from attack import BY_NAME, attack, rebuild, seeds
from mutations import mutated
from writers import WRITERS

from lab.base.files.file_content import TextBlocks, read_whole
from lab.data.formats import read_raw
from lab.missions import MissionError

ATTACKS = 30


def test_every_reader_has_a_writer():
    assert set(WRITERS) == set(BY_NAME)


@pytest.mark.proof
@pytest.mark.parametrize("name", BY_NAME)
def test_hostile_files_give_a_flight_or_a_reason(name, tmp_path):
    files, rng = seeds(name), np.random.default_rng(zlib.crc32(name.encode()))
    flights = 0
    for count in range(ATTACKS):
        hostile = {file: mutated(seed, rng) for file, seed in files.items()}
        flight = attack(name, tmp_path, hostile, weigh=count % 15 == 0)
        if flight is not None and count % 20 == 1:
            rebuild([tmp_path / file for file in hostile])
        flights += flight is not None
    assert attack(name, tmp_path, files) is not None
    # Attacks that are all refused at the door would test nothing else.
    assert name == "INS Lab flight csv" or flights >= 2


@pytest.mark.proof
@pytest.mark.parametrize("name", BY_NAME)
def test_memory_and_time_stay_in_proportion(name, tmp_path):
    assert attack(name, tmp_path, seeds(name, 80.0), weigh=True) is not None
    assert attack(name, tmp_path, seeds(name, 80.0)) is not None


@pytest.mark.proof
@pytest.mark.parametrize("name", BY_NAME)
def test_a_zip_bomb_is_refused(name, tmp_path):
    path = tmp_path / "bomb.gz"
    seed = next(iter(seeds(name).values()))
    # Its last line or message again and again compresses to less than a hundredth.
    with gzip.open(path, "wb", 6) as file:
        file.write(seed)
        for _ in range(30):
            file.write((seed[-400:] + b"\n") * 2500)
    assert path.stat().st_size < 2.5e5
    # Some readers stop at the first line that is not theirs, and see nothing of the rest.
    if name in {"GPX", "KML", "TCX"}:
        assert len(BY_NAME[name].read([path], {}).time) == (32 if name == "KML" else 8)
    else:
        early = name == "INS Lab flight csv"
        with pytest.raises(MissionError, match="row 147" if early else "grows more than 100 times"):
            BY_NAME[name].read([path], {})


def test_what_grows_too_much_is_refused_by_both_ways_to_read(tmp_path):
    path = tmp_path / "bomb.gz"
    path.write_bytes(gzip.compress(b"1,2,3\n" * 5_000_000))
    with pytest.raises(MissionError, match="grows more than 100 times"):
        read_whole(path, 2**30)
    with pytest.raises(MissionError, match="grows more than 100 times"), TextBlocks(path, 2**30) as text:
        list(text.blocks())
    path.write_bytes(gzip.compress(b"1,2,3\n" * 100_000))  # small enough to be harmless
    assert len(read_whole(path, 2**30)) == 600_000
    with pytest.raises(MissionError, match="up to 0 MB when decompressed"):
        read_whole(path, 100_000)


@pytest.mark.parametrize("name", BY_NAME)
def test_a_compressed_file_is_read_as_the_plain_one(name, tmp_path):
    file, seed = next(iter(seeds(name).items()))
    plain, packed = tmp_path / file, tmp_path / f"{file}.gz"
    plain.write_bytes(seed)
    packed.write_bytes(gzip.compress(seed))
    np.testing.assert_array_equal(read_raw(packed).time, read_raw(plain).time)
    packed.write_bytes(gzip.compress(seed)[:-20])
    with pytest.raises(MissionError, match=r"gzip|cannot be read"):
        read_raw(packed)


@pytest.mark.parametrize("name", BY_NAME)
def test_paths_that_are_no_files(name, tmp_path):
    places = [
        tmp_path / "../../no/such/file", tmp_path, tmp_path / "nul\0byte", tmp_path / "-rf",
        tmp_path / ("x" * 300), tmp_path / "$(id)\n;<b>",
    ]  # fmt: skip
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        places.append(tmp_path / "pipe")
    for place in places:
        with pytest.raises(MissionError, match=r"is a folder|no such file|not an ordinary|cannot be read"):
            BY_NAME[name].read([place], {})
        with pytest.raises(MissionError):
            read_raw(place)
