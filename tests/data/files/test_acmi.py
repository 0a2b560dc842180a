"""Tacview ACMI: objects with places relative to a reference, of which one is the flight."""

from __future__ import annotations

import contextlib
import io
import tracemalloc
import zipfile

import numpy as np
import pytest
from writers.acmi import write

from lab.data.formats import read_raw
from lab.missions import MissionError, mission, prepare_import
from lab.motion.truth.trajectory import Trajectory

HEAD = "FileType=text/acmi/tacview\nFileVersion=2.1\n"


def flight(tmp_path, text: str):
    (tmp_path / "a.txt.acmi").write_bytes(text.encode())
    return read_raw(tmp_path / "a.txt.acmi")


def test_the_aircraft_is_the_flight(tmp_path):
    (tmp_path / "a.acmi").write_bytes(write(mission("montreal").recording))
    read = read_raw(tmp_path / "a.acmi")
    truth = Trajectory.from_recording(mission("montreal").recording, 100.0).at(read.time)
    np.testing.assert_allclose(read.latitude, truth.latitude, atol=2e-9)
    np.testing.assert_allclose(read.longitude, truth.longitude, atol=2e-9)
    np.testing.assert_allclose(read.height, truth.height, atol=0.006)
    apart = np.angle(np.exp(1j * (read.euler - truth.euler)))
    np.testing.assert_allclose(apart, 0, atol=np.radians(6e-4))
    assert read.vehicle == "aircraft"
    said = " ".join(read.remarks)
    assert "C172, One, Two (3000102), which of 2 objects" in said
    assert "Not read: IAS." in said
    assert "2024-05-17T23:58:30Z" in said
    assert prepare_import([tmp_path / "a.acmi"]).report.verdict == "plausible"


def test_a_zip_file_is_the_same(tmp_path):
    data = write(mission("montreal").recording)
    with zipfile.ZipFile(tmp_path / "a.zip.acmi", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("flight.txt.acmi", data)
    (tmp_path / "a.txt.acmi").write_bytes(data)
    zipped, plain = read_raw(tmp_path / "a.zip.acmi"), read_raw(tmp_path / "a.txt.acmi")
    assert zipped.format == "Tacview ACMI"
    np.testing.assert_array_equal(zipped.latitude, plain.latitude)
    packed = (tmp_path / "a.zip.acmi").read_bytes()
    for size in (40, len(packed) // 2, len(packed) - 10):
        (tmp_path / "a.zip.acmi").write_bytes(packed[:size])
        with pytest.raises(MissionError, match="zip file"):
            read_raw(tmp_path / "a.zip.acmi")


def test_a_zip_bomb_is_refused(tmp_path):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bomb.acmi", HEAD.encode() + b"#1\n" * 20_000_000)
    (tmp_path / "a.acmi").write_bytes(out.getvalue())
    with pytest.raises(MissionError, match="grows more than"):
        read_raw(tmp_path / "a.acmi")


@pytest.mark.parametrize(
    ("form", "attitude"),
    [("{x}|{y}|{z}", False), ("{x}|{y}|{z}|1|2", False), ("{x}|{y}|{z}|1|2|3", True),
     ("{x}|{y}|{z}|1|2|3|100|200|4", True)],
)  # fmt: skip
def test_all_forms_of_a_transform(tmp_path, form, attitude):
    """Three, five, six and nine components, as the reference lists them."""
    rows = "".join(
        f"#{t}\n1a,T={form.format(x=5 + 1e-4 * t, y=10 + 1e-4 * t, z=100 + t)}\n" for t in range(8)
    )
    read = flight(tmp_path, HEAD + "0,ReferenceLongitude=-60\n0,ReferenceLatitude=-30\n" + rows)
    np.testing.assert_allclose(np.degrees(read.longitude), -55 + 1e-4 * np.arange(8))
    np.testing.assert_allclose(np.degrees(read.latitude), -20 + 1e-4 * np.arange(8))
    np.testing.assert_allclose(read.height, 100 + np.arange(8.0))
    if attitude:
        np.testing.assert_allclose(np.degrees(read.euler), np.tile((1, 2, 3), (8, 1)))
    else:
        assert read.euler is None


def test_lines_may_end_as_on_windows(tmp_path):
    data = write(mission("montreal").recording)
    (tmp_path / "a.acmi").write_bytes(data.replace(b"\n", b"\r\n"))
    windows = read_raw(tmp_path / "a.acmi")
    (tmp_path / "a.acmi").write_bytes(data)
    np.testing.assert_array_equal(windows.latitude, read_raw(tmp_path / "a.acmi").latitude)
    assert "which of 2 objects" in " ".join(windows.remarks)
    assert "2024-05-17T23:58:30Z." in " ".join(windows.remarks)


def test_a_number_that_is_used_again_is_another_object(tmp_path):
    rows = "".join(f"#{t}\n1,T={1 + 1e-4 * t}|2|3,Name=first\n" for t in range(6))
    rows += "#6\n-1\n" + "".join(f"#{t}\n1,T={9 + 1e-4 * t}|2|3,Name=second\n" for t in range(7, 20))
    read = flight(tmp_path, HEAD + rows)
    assert len(read.time) == 13
    assert np.degrees(read.longitude[0]) == pytest.approx(9.0007)
    assert "second" in " ".join(read.remarks)


@pytest.mark.parametrize(
    ("kind", "vehicle"),
    [("Air+Rotorcraft", "copter"), ("Ground+Light+Vehicle", "car"), ("Sea+Watercraft", "boat"),
     ("Weapon+Missile", "rocket"), ("Ground+Light+Human+Infantry", "pedestrian"), ("Misc", "")],
)  # fmt: skip
def test_the_type_names_the_vehicle(tmp_path, kind, vehicle):
    rows = "".join(f"#{t}\n1,T={1 + 1e-4 * t}|2|3,Type={kind}\n" for t in range(6))
    assert flight(tmp_path, HEAD + rows).vehicle == vehicle


def test_what_cannot_be_read_is_said(tmp_path):
    with pytest.raises(MissionError, match="none of its 1 objects has a position"):
        flight(tmp_path, HEAD + "#1\n1,Name=a\n")
    with pytest.raises(MissionError, match=r"version 1\.7; accepted is 2\.x"):
        flight(tmp_path, HEAD.replace("2.1", "1.7"))
    rows = "".join(f"#{t}\n1,T={1 + 1e-4 * t}|2|3\n1,T=1|2|3|4\n" for t in range(6))
    assert flight(tmp_path, HEAD + rows).dropped[0].count == 6
    rows = "".join(f"#{t}\n1,T=nan|2|inf\n" for t in range(6))
    with pytest.raises(MissionError, match="without a position on the Earth"):
        flight(tmp_path, HEAD + rows)


@pytest.mark.parametrize(
    "line", ["{0:x},\n", "{0:x},T=1|2|3\n", "1,T={0}|2|3\n", "-{0:x}\n", "{0:x},A{0}=1\n", "0,A{0}=1\n"]
)
def test_many_objects_take_memory_in_proportion(tmp_path, line):
    text = HEAD + "#1\n" + "".join(line.format(at) for at in range(100_000))
    (tmp_path / "a.acmi").write_bytes(text.encode())
    tracemalloc.start()
    with contextlib.suppress(MissionError):
        read_raw(tmp_path / "a.acmi")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10 * len(text) + 12e6


@pytest.mark.parametrize("names", [["a.acmi"], ["a.csv"], ["x/oxts/data/0.txt", "x/oxts/timestamps.txt"]])
def test_a_zip_file_with_a_false_size_takes_little_memory(tmp_path, names):
    """The entry says ten bytes where 100 MB follow."""
    out, size = io.BytesIO(), 100 * 2**20
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            archive.writestr(name, bytes(size))
    false = out.getvalue().replace(size.to_bytes(4, "little"), (10).to_bytes(4, "little"))
    (tmp_path / "a.zip").write_bytes(false)
    tracemalloc.start()
    with pytest.raises(MissionError, match="not a complete zip file"):
        read_raw(tmp_path / "a.zip")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 0.2 * size
