"""The library: missions are added, renamed, described and deleted whole, and nothing else is touched."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from flights import circle
from hypothesis import given
from hypothesis import strategies as st
from sensor_logs import tables, write

from lab.base.files.locks import LOCK_FILE
from lab.base.parameters.toml_file import MAX_BYTES
from lab.missions import (
    MissionError,
    add_log,
    broken_missions,
    mission,
    missions,
    read_sensor_log,
    shipped_folder,
)
from lab.missions import library as shelf
from lab.missions.catalogue import OWN_FOLDER_VARIABLE
from lab.missions.library import (
    add_mission,
    delete_mission,
    describe_mission,
    free_name,
    rename_mission,
    take_mission_away,
    user_names,
)
from lab.missions.mission import read_toml
from lab.missions.mission_name import MAX_LETTERS, accepted_name, suggested_name, without_archive

PLAN = tomllib.loads((shipped_folder() / "montreal.toml").read_text(encoding="utf-8"))["flight"]


@pytest.fixture
def own(tmp_path, monkeypatch) -> Path:
    """Return the folder of the user's own missions, which does not exist yet."""
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path / "own"))
    return tmp_path / "own"


@pytest.fixture
def outside(tmp_path) -> Path:
    """Return a file beside the folder of the missions, which must stay as it is."""
    file = tmp_path / "outside.csv"
    file.write_text("precious")
    return file


def files(folder: Path) -> list[str]:
    """Return the files there are, but for that of the lock."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.name != LOCK_FILE)


def test_a_mission_is_added_as_given(own):
    flight = circle()
    added = add_mission(
        flight,
        "round trip",
        title=" A circle ",
        description='Round\n"and" round',
        origin="computed",
        aircraft="none",
        airport="nowhere",
        tags=["turn", " turn ", "", "level"],
        flight=PLAN,
        ending="stalled",
    )
    found = mission("round trip")
    assert (added.name, found.name, found.title) == ("round trip", "round trip", "A circle")
    assert (found.description, found.origin) == ('Round\n"and" round', "computed")
    assert (found.aircraft, found.airport, found.tags) == ("none", "nowhere", ("turn", "level"))
    assert found.ending == "stalled"
    assert found.plan == mission("montreal").plan
    np.testing.assert_allclose(found.recording.latitude, flight.latitude, atol=1e-13)
    assert files(own) == ["round trip.csv.gz", "round trip.toml"]
    assert '"""Round\n' in (own / "round trip.toml").read_text(encoding="utf-8")  # a line is a line
    assert user_names() == {"round trip"}


def test_a_name_taken_is_refused_and_replaced_only_if_asked(own):
    add_mission(circle(), "one", title="First")
    before = {name: (own / name).read_bytes() for name in files(own)}
    with pytest.raises(MissionError, match="'one': a mission has it"):
        add_mission(circle(turn=90), "one", title="Second")
    assert {name: (own / name).read_bytes() for name in files(own)} == before
    replaced = add_mission(circle(samples=300), "one", title="Second", overwrite=True)
    assert replaced.title == "Second"
    assert len(replaced.recording.time) == 300
    assert len(files(own)) == 2


def test_a_name_taken_is_refused_before_anything_is_written(own, monkeypatch):
    log = read_sensor_log(write(own.parent / "drive", tables(60, 80)))
    add_mission(circle(), "one", title="First")
    for step in ("write_flight_csv", "write_sensor_log"):
        monkeypatch.setattr(shelf, step, lambda *_given, **_named: pytest.fail("written"))
    for add, what in ((add_mission, circle()), (add_log, log)):
        with pytest.raises(MissionError, match="'one': a mission has it"):
            add(what, "one", title="Second")


def test_the_folder_of_the_library_is_made_with_those_above_it(tmp_path):
    log = read_sensor_log(write(tmp_path / "drive", tables(60, 80)))
    add_mission(circle(), "one", title="x", folder=tmp_path / "a" / "b")
    assert files(tmp_path / "a") == ["b", "b/one.csv.gz", "b/one.toml"]
    add_log(log, "one", title="x", folder=tmp_path / "c" / "d")
    assert "d/one/imu.csv" in files(tmp_path / "c")
    with pytest.raises(MissionError, match="mission two: title = ' '"):
        add_log(log, "two", title=" ", folder=tmp_path / "c" / "d")


def test_names_of_shipped_missions_and_of_logs_are_taken(own):
    own.mkdir()
    write(own / "drive", tables(60, 80))
    for name in ("montreal", "drive"):
        for overwrite in (False, True):
            with pytest.raises(MissionError, match="choose another name"):
                add_mission(circle(), name, title="x", overwrite=overwrite)
    assert files(own) == ["drive", "drive/gnss.csv", "drive/imu.csv", "drive/ref.csv"]


@pytest.mark.parametrize(
    "name",
    [
        "", ".", "..", "../up", "a/b", "a\\b", "/etc/passwd", "C:x", "user:x", "nul", "COM1.flight", "log",
        "a\0b", "x.toml", "x.CSV", "x.csv.gz", " x", "x ", "x.", "-x", ".hidden", "a\nb", "\ud800", "<b>",
        "a*b", "x" * 49, "\u202eabc",
    ],
)  # fmt: skip
def test_names_that_lead_elsewhere_or_mean_something_else_are_refused(own, name):
    with pytest.raises(MissionError, match="accepted are 1 to 48 letters"):
        add_mission(circle(), name, title="x")
    add_mission(circle(), "sound", title="x")
    with pytest.raises(MissionError, match="accepted are 1 to 48 letters"):
        rename_mission("sound", name)
    assert files(own) == ["sound.csv.gz", "sound.toml"]


@given(text=st.text(max_size=80))
def test_every_text_has_a_name_and_every_accepted_name_is_a_file_of_the_folder(text):
    name = suggested_name(text)
    assert accepted_name(name) == name
    for candidate in (text, name):
        try:
            plain = accepted_name(candidate)
        except MissionError:
            continue
        path = Path("folder", f"{plain}.toml")
        assert path.parent == Path("folder")
        assert path.stem == plain
        assert len(os.fsencode(f".{plain}.999.csv.gz.12345678")) <= 255
        assert suggested_name(plain) == plain or plain.strip(" -_.+()") != plain


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Data.csv", "Data"),
        ("My flight (2).csv.gz", "My flight (2"),
        ("../../etc/passwd", "etc_passwd"),
        ("nul", "mission_nul"),
        ("日本.ulg", "日本.ulg"),
        ("???", "mission"),
        ("x" * 300, "x" * MAX_LETTERS),
    ],
)
def test_names_suggested(text, name):
    assert suggested_name(text) == name


def test_free_names_are_counted(own):
    assert free_name("montreal.csv") == "montreal_2"
    assert free_name(without_archive("2023-11-14_22-13-20.ZIP")) == "2023-11-14_22-13-20"
    add_mission(circle(), "Montreal_2", title="x")
    assert free_name("montreal") == "montreal_3"
    add_mission(circle(), "x" * MAX_LETTERS, title="x")
    longest = free_name("x" * MAX_LETTERS)
    assert accepted_name(longest) == longest
    assert longest.endswith("x_2")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"title": "  "}, "title = '  '; accepted is a text"),
        ({"tags": "turns"}, "accepted is a list of texts"),
        ({"flight": {"duration_s": 5}}, "is missing"),
        ({"description": "x" * 2**20}, "too long"),
        ({"description": "\ud800"}, "is not a valid character"),
        ({"recording": circle(samples=3)}, "accepted are at least 4"),
    ],
)
def test_what_could_not_be_read_again_is_not_written(own, change, message):
    with pytest.raises(MissionError, match=message):
        add_mission(**({"recording": circle(), "name": "bad", "title": "x"} | change))
    assert not own.exists() or files(own) == []


def test_a_crash_leaves_no_half_mission(own, monkeypatch):
    add_mission(circle(), "one", title="First")

    class Crash(BaseException):
        """Power failure: not even the file of the present step is cleared away."""

    def crash(*_arguments: object, **_options: object) -> None:
        raise Crash

    for step in ("write_flight_csv", "replace_toml"):
        for overwrite in (False, True):
            with monkeypatch.context() as patch:
                patch.setattr(shelf, step, crash)
                patch.setattr(Path, "unlink", lambda *_arguments, **_options: None)
                with pytest.raises(Crash):
                    add_mission(
                        circle(samples=300), "one" if overwrite else "two", title="x", overwrite=overwrite
                    )
            assert broken_missions() == {}
            assert list(missions()) == ["los_angeles", "montreal", "pacific", "one"]
            assert len(mission("one").recording.time) == 400
    assert add_mission(circle(samples=300), "two", title="x").duration < mission("one").duration


@pytest.mark.parametrize("what", ["flight", "log"])
def test_a_name_taken_while_the_files_were_written_is_refused(own, monkeypatch, what):
    """Both found the name free; the one that comes second to the lock leaves nothing behind."""
    step = {"flight": "write_flight_csv", "log": "write_sensor_log"}[what]
    honest = getattr(shelf, step)

    def overtaken(*given, **named):
        monkeypatch.setattr(shelf, step, honest)
        add_mission(circle(samples=300), "one", title="First")
        honest(*given, **named)

    own.mkdir()
    log = read_sensor_log(write(own.parent / "drive", tables(60, 80)))
    monkeypatch.setattr(shelf, step, overtaken)
    with pytest.raises(MissionError, match="'one': a mission has it"):
        if what == "flight":
            add_mission(circle(), "one", title="Second")
        else:
            add_log(log, "one", title="Second")
    assert mission("one").title == "First"
    assert len(mission("one").recording.time) == 300
    assert len(files(own)) == 2


@pytest.mark.proof
def test_several_processes_add_at_once(own):
    code = (
        "import sys; sys.path.insert(0, 'tests')\n"
        "from flights import circle\nfrom lab.missions import MissionError\n"
        "from lab.missions.library import add_mission\n"
        "flight = circle(samples=300 + int(sys.argv[1]))\n"
        "print('ready', flush=True); input()\n"
        "for number in range(10):\n"
        "    for overwrite in (False, True):\n"
        "        try: add_mission(flight, f'shared_{number}', title=sys.argv[1], overwrite=overwrite)\n"
        "        except MissionError as error: assert 'a mission has it' in str(error)\n"
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(which)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        for which in range(3)
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    assert [process.wait(timeout=60) for process in processes] == [0, 0, 0]
    assert broken_missions() == {}
    for number in range(10):
        found = mission(f"shared_{number}")
        assert len(found.recording.time) == 300 + int(found.title)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_said(own):
    add_mission(circle(), "one", title="x")
    own.chmod(0o500)
    try:
        refuses_all_changes("Permission denied")
    finally:
        own.chmod(0o700)
    assert files(own) == ["one.csv.gz", "one.toml"]


def test_a_folder_that_cannot_be_locked_is_said(own):
    add_mission(circle(), "one", title="x")
    (own / LOCK_FILE).unlink()
    (own / LOCK_FILE).mkdir()
    refuses_all_changes("Is a directory")
    with pytest.raises(MissionError, match=f"{LOCK_FILE}: cannot be changed"):
        delete_mission("one")
    assert files(own) == ["one.csv.gz", "one.toml"]


def refuses_all_changes(message: str) -> None:
    """Check that a mission called one cannot be changed, nor another or a log be added."""
    with tempfile.TemporaryDirectory() as folder:
        log = read_sensor_log(write(Path(folder) / "drive", tables(60, 80)))
    for act in (
        lambda: add_mission(circle(), "two", title="x"),
        lambda: add_log(log, "two", title="x"),
        lambda: rename_mission("one", "two"),
        lambda: describe_mission("one", title="y"),
        lambda: delete_mission("one"),
    ):
        with pytest.raises(MissionError, match=f"cannot be changed: {message}"):
            act()


def test_a_file_in_place_of_the_folder_is_said(own):
    own.write_text("no folder")
    with pytest.raises(MissionError, match="own: cannot be changed"):
        add_mission(circle(), "two", title="x")


def test_a_mission_is_renamed_whole(own):
    add_mission(circle(), "one", title="x")
    add_mission(circle(), "three", title="x")
    with pytest.raises(MissionError, match="'three': a mission has it"):
        rename_mission("one", "three")
    with pytest.raises(MissionError, match="'montreal': ships"):
        rename_mission("one", "montreal")
    renamed = rename_mission("one", "two")
    assert (renamed.name, list(missions())) == ("two", ["los_angeles", "montreal", "pacific", "three", "two"])
    assert renamed.duration == circle().duration
    assert rename_mission("two", "two").name == "two"
    assert add_mission(circle(), "one", title="again").recording_path != mission("two").recording_path
    delete_mission("one")
    assert mission("two").duration == circle().duration


def test_one_with_the_name_of_a_shipped_one_is_reached(own):
    own.mkdir()
    for ending in (".toml", ".csv.gz"):
        (own / f"montreal{ending}").write_bytes((shipped_folder() / f"montreal{ending}").read_bytes())
    assert "user:montreal" in user_names()
    assert rename_mission("user:montreal", "mine").name == "mine"
    delete_mission("mine")
    assert files(own) == []


def test_words_are_changed_and_the_rest_stays(own):
    add_mission(circle(), "one", title="x", flight=PLAN, description="Round")
    toml = own / "one.toml"
    toml.write_text(
        "# mine\n" + toml.read_text(encoding="utf-8").replace("tags = []\n", ""), encoding="utf-8"
    )
    before = tomllib.loads(toml.read_text(encoding="utf-8"))
    changed = describe_mission("one", title="Größe", tags=("a", "b"))
    assert (changed.title, changed.tags, changed.description) == ("Größe", ("a", "b"), "Round")
    text = toml.read_text(encoding="utf-8")
    assert text.startswith("# mine\n")
    assert tomllib.loads(text) == before | {"title": "Größe", "tags": ["a", "b"]}
    assert describe_mission("one", description="", tags=[]).description == ""
    with pytest.raises(MissionError, match="title = ''"):
        describe_mission("one", title="")
    with pytest.raises(MissionError, match="ships with the lab"):
        describe_mission("montreal", title="x")


def test_a_mission_is_deleted_and_no_other(own):
    add_mission(circle(), "one", title="x")
    add_mission(circle(), "two", title="x")
    (own / "three.toml").write_text('title = "same flight"\nrecording = "one.csv.gz"\n')
    (own / "notes.txt").write_text("mine")
    delete_mission("one")
    assert files(own) == ["notes.txt", "one.csv.gz", "three.toml", "two.csv.gz", "two.toml"]
    delete_mission("three")
    assert files(own) == ["notes.txt", "two.csv.gz", "two.toml"]
    for name, message in (("montreal", "ships with the lab"), ("one", "Accepted are your own: two")):
        with pytest.raises(MissionError, match=message):
            delete_mission(name)
    assert (shipped_folder() / "montreal.toml").exists()


@pytest.mark.parametrize("recording", ["../outside.csv", "notes.txt", "two.toml", "missing.csv"])
def test_a_broken_mission_is_deleted_and_nothing_it_points_to(own, outside, recording):
    add_mission(circle(), "two", title="x")
    (own / "notes.txt").write_text("mine")
    (own / "odd.toml").write_text(f'title = "odd"\nrecording = "{recording}"\n')
    assert "odd" in user_names()
    delete_mission("odd")
    assert files(own) == ["notes.txt", "two.csv.gz", "two.toml"]
    assert outside.read_text() == "precious"


def test_links_are_not_followed(own, outside, tmp_path):
    add_mission(circle(), "one", title="x", folder=tmp_path / "elsewhere")
    log = write(tmp_path / "log", tables(60, 80))
    own.mkdir()
    (own / "link.toml").symlink_to(tmp_path / "elsewhere" / "one.toml")
    (own / "one.csv.gz").symlink_to(outside)
    (own / "drive").symlink_to(log)
    before = files(log)
    assert rename_mission("drive", "way").name == "way"
    for name in ("link", "way"):
        delete_mission(name)
    assert outside.read_text() == "precious"
    assert files(log) == before
    assert files(tmp_path / "elsewhere") == ["one.csv.gz", "one.toml"]
    assert files(own) == ["one.csv.gz"]


def test_what_a_link_names_is_not_replaced_with_it(own, tmp_path):
    add_mission(circle(), "one", title="x", folder=tmp_path / "elsewhere")
    own.mkdir()
    (own / "link.toml").symlink_to(tmp_path / "elsewhere" / "one.toml")
    (own / "one.csv.gz").write_bytes(b"mine")
    add_mission(circle(), "link", title="y", overwrite=True)
    assert mission("link").title == "y"
    assert files(own) == ["link.csv.gz", "link.toml", "one.csv.gz"]
    assert files(tmp_path / "elsewhere") == ["one.csv.gz", "one.toml"]


def test_the_largest_file_that_is_written_is_the_largest_that_is_read(tmp_path):
    toml = tmp_path / "one.toml"
    toml.write_bytes(shelf.encode_toml("#" * MAX_BYTES, toml))
    assert read_toml(toml) == {}
    with pytest.raises(MissionError, match="too long"):
        shelf.encode_toml("#" * (MAX_BYTES + 1), toml)


def test_a_log_is_deleted_with_the_files_it_names(own):
    own.mkdir()
    for name, place in (("folder", own / "folder" / "log.toml"), ("single", own / "single.toml")):
        log = write(place.parent if name == "folder" else own.parent / "source", tables(60, 80))
        (log / "ref.csv").unlink()
        for file in ("imu", "gnss"):
            (log / f"{file}.csv").rename(place.parent / f"{name}_{file}.csv")
        place.write_text(f'title = "x"\nimu = "{name}_imu.csv"\ngnss = "{name}_gnss.csv"\n')
        assert mission(name).title == "x"
        delete_mission(name)
    assert files(own) == []


def test_an_own_folder_that_is_the_shipped_one_is_safe(monkeypatch, tmp_path):
    for named in (shipped_folder(), tmp_path / "link"):
        if not named.exists():
            named.symlink_to(shipped_folder())
        monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(named))
        assert user_names() == set()


def test_logs_are_renamed_described_and_deleted(own, outside):
    own.mkdir()
    write(own / "drive", tables(60, 80))
    assert rename_mission("drive", "to work").name == "to work"
    before = files(own)
    describe_mission("to work")
    assert files(own) == before
    described = describe_mission("to work", title="To work", description="By car", tags=["car"])
    assert (described.title, described.description, described.tags) == ("To work", "By car", ("car",))
    write(own / "other", tables(60, 80))
    with pytest.raises(MissionError, match="'other': a log has it"):
        rename_mission("to work", "other")
    (own / "full").mkdir()
    with pytest.raises(MissionError, match="is there already"):
        rename_mission("to work", "full")
    (own / "other" / "notes.txt").write_text("mine")
    (own / "to work" / "ref.csv").unlink()
    (own / "to work" / "ref.csv").symlink_to(outside)
    delete_mission("to work")
    delete_mission("other")
    assert files(own) == ["full", "other", "other/notes.txt"]
    assert outside.read_text() == "precious"
    assert list(missions()) == ["los_angeles", "montreal", "pacific"]


def test_a_deleted_mission_is_brought_back_unless_another_took_its_place(own):
    add_mission(circle(), "one", title="One")
    before = {path.name: path.read_bytes() for path in own.iterdir() if path.is_file()}
    taken = take_mission_away("one")
    assert "one" not in missions()
    taken.restore()
    assert {path.name: path.read_bytes() for path in own.iterdir() if path.is_file()} == before
    with pytest.raises(MissionError, match="its files are gone"):
        taken.restore()
    taken = take_mission_away("one")
    add_mission(circle(), "one", title="Another")
    with pytest.raises(MissionError, match="another file is there now"):
        taken.restore()
    assert mission("one").title == "Another"
    taken.forget()
    assert sorted(path.name for path in own.iterdir()) == sorted(before)


def test_a_deleted_log_is_brought_back_into_its_folder(own):
    own.mkdir()
    write(own / "drive", tables(60, 80))
    before = {path.relative_to(own): path.read_bytes() for path in (own / "drive").iterdir()}
    taken = take_mission_away("drive")
    assert "drive" not in missions()
    taken.restore()
    assert {path.relative_to(own): path.read_bytes() for path in (own / "drive").iterdir()} == before
