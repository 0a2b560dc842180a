"""Algorithms out of files that a user names: found, or refused with what is wrong and where."""

from __future__ import annotations

from pathlib import Path

import pytest

from lab.navigation.algorithm import AlgorithmError, load_algorithm, load_algorithms

TEXT = """\
import dataclasses
import beside_it


@dataclasses.dataclass
class Mine:
    gain: float = beside_it.GAIN

    def navigate(self, imu, fixes, start):
        return None


class Needy:
    def __init__(self, gain):
        self.gain = gain

    def navigate(self, imu, fixes, start):
        return None


class Failing:
    def __init__(self):
        raise OSError("no licence")

    navigate = Mine.navigate


ready = Mine(3.0)
number = 3
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))  # put back afterwards
    (tmp_path / "beside_it.py").write_text("GAIN = 2.0\n")
    (tmp_path / "mine.py").write_text(TEXT)
    (tmp_path / "other.py").write_text(TEXT)
    (tmp_path / "odd.py").write_text("a = 1\nb = a +\n")
    (tmp_path / "broken.py").write_text("a = 1\nb = a / 0\n")
    (tmp_path / "leaves.py").write_text("raise SystemExit(3)\n")
    return tmp_path


def test_a_class_is_called_and_a_ready_object_taken_as_it_is(folder: Path) -> None:
    assert vars(load_algorithm(f"{folder}/mine.py:Mine")) == {"gain": 2.0}
    assert vars(load_algorithm(f"{folder}/mine.py:ready")) == {"gain": 3.0}


def test_each_loading_gives_objects_of_its_own(folder: Path) -> None:
    place = f"{folder}/mine.py:ready"
    assert load_algorithm(place) is not load_algorithm(place)


def test_algorithms_of_one_name_are_told_apart_by_their_files(folder: Path) -> None:
    places = [f"{folder}/mine.py:Mine", f"{folder}/other.py:Mine", f"{folder}/mine.py:ready"]
    assert list(load_algorithms(places)) == [*places[:2], "ready"]


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("mine.py", r"'mine.py': accepted is FILE.py:Name"),
        ("mine:Mine", "accepted is FILE.py:Name"),
        ("mine.py:1", "accepted is FILE.py:Name"),
        ("nowhere.py:Mine", "nowhere.py: there is no such file"),
        ("mine.py:Nobody", "has no 'Nobody'; algorithms in the file: Failing, Mine, Needy, ready"),
        ("mine.py:number", r"of type int, without a method navigate\(imu, fixes, start\)"),
        ("mine.py:Needy", "called without arguments, it fails: TypeError: .*'gain'"),
        ("mine.py:Failing", "fails: mine.py, line 23, in __init__: OSError: no licence"),
        ("odd.py:Mine", "odd.py, line 2: invalid syntax"),
        ("broken.py:Mine", "raised an exception: broken.py, line 2, in <module>: ZeroDivisionError"),
        ("leaves.py:Mine", "raised an exception: leaves.py, line 1, in <module>: SystemExit: 3"),
    ],
)
def test_what_cannot_be_loaded_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, place: str, words: str
) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(AlgorithmError, match=words):
        load_algorithm(place)
