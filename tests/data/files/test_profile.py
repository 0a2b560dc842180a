"""Profiles: a maker's csv is a TOML file; hostile, double and broken ones are refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_logs import tables

from lab.base.files.mission_error import QuestionError
from lab.data.files.profile import FOLDER_VARIABLE, profile_of, read_profile, shipped_profiles
from lab.data.formats import READERS, read_raw
from lab.data.sheets.profile_check import check_profile, columns_in, save_profile
from lab.missions import MissionError
from lab.missions.flight_import import read_log

MINE = """
name = "My logger"
needs = ["t_ms", "q1", "q2", "q3"]
[columns]
"t_ms" = "time[ms]"
"q1" = "latitude[1e-7°]"
"q2" = "longitude[1e-7°]"
"q3" = "height[cm]"
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Return the folder of the owner's profiles, which is empty."""
    folder = tmp_path / "profiles"
    folder.mkdir()
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    return folder


def csv(path, head="t_ms,q1,q2,q3", extra=""):
    rows = [f"{200 * i},{465_000_000 + 900 * i},{70_000_000 + 400 * i},{90_000 + i}" for i in range(60)]
    rows = [f"{row}{extra}" for row in rows]
    path.write_text("\n".join((head, *rows)))
    return path


@pytest.mark.parametrize("profile", shipped_profiles(), ids=lambda one: one.name)
def test_each_that_ships_can_be_used_and_has_its_own_headings(profile):
    check_profile(profile)
    headings = list(dict.fromkeys((*(need[0] for need in profile.needs), *profile.columns)))
    head = ",".join(headings).encode() + b"\n" + b",".join([b"1"] * len(headings)) + b"\n"
    if profile.simulator:
        assert [one.name for one in READERS[:-1] if one.recognises(head)] == [profile.name]
    else:
        assert profile_of("a.csv", headings) == profile
    assert (profile.name in {one.name for one in READERS}) == profile.simulator


def test_a_file_of_a_new_maker_is_one_toml(own, tmp_path):
    path = csv(tmp_path / "a.csv")
    with pytest.raises(MissionError, match="its format is unknown"):
        read_raw(path)
    (own / "mine.toml").write_text(MINE)
    flight = read_raw(path)
    np.testing.assert_allclose(np.degrees(flight.latitude[:2]), [46.5, 46.50009])
    np.testing.assert_allclose(flight.height[:2], [900.0, 900.01])
    np.testing.assert_allclose(np.diff(flight.time), 0.2)
    assert any("My logger (mine.toml)" in remark for remark in flight.remarks)
    # A person's word counts more.
    given_ = read_raw(path, {"q3": "height[m]"})
    np.testing.assert_allclose(given_.height[0], 90_000.0)


def test_a_profile_does_not_claim_files_that_lack_a_heading(own, tmp_path):
    (own / "mine.toml").write_text(MINE)
    path = csv(tmp_path / "a.csv", head="time,lat,lon,q3")
    assert not any("My logger" in remark for remark in read_raw(path).remarks)


def test_two_that_match_one_file_are_refused_by_name(own, tmp_path):
    (own / "mine.toml").write_text(MINE)
    (own / "other.toml").write_text(MINE.replace("My logger", "Another").replace('"q3"]', '"q4"]'))
    path = csv(tmp_path / "a.csv", head="t_ms,q1,q2,q3,q4", extra=",1")
    with pytest.raises(MissionError, match=r"several profiles: My logger \(.*\) and Another \("):
        read_raw(path)
    assert read_raw(csv(tmp_path / "b.csv")).format == "csv with named columns"
    # One that needs more headings is the more particular one.
    (own / "other.toml").write_text(MINE.replace("My logger", "Another").replace('"q3"]', '"q3", "q4"]'))
    assert profile_of("a.csv", ["t_ms", "q1", "q2", "q3", "q4"]).name == "Another"
    (own / "other.toml").write_text(MINE.replace("My logger", "Another"))
    with pytest.raises(MissionError, match=r"My logger \(.*needs the same headings"):
        check_profile(read_profile(own / "other.toml"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the profile has no name"),
        ('name = "x"\n', "the profile has no headings"),
        ('name = 3\n[columns]\na = "time"', "name = 3; accepted is text"),
        ('name = "x"\nned = ["a"]', "there is no key 'ned'. Did you mean needs"),
        ('name = "x"\nneeds = "a"', "needs = 'a'; accepted is a list"),
        ('name = "x"\nneeds = [[]]', "accepted is a list"),
        ('name = "x"\nphone = "yes"\n[columns]\na = "time"', "phone = 'yes'; accepted are true and false"),
        ('name = "x"\nremarks = [3]\n[columns]\na = "time"', "accepted is a list of texts"),
        ('name = "x"\n[columns]\na = 3', "accepted as .columns. are"),
        (f'name = "x"\n[columns]\na = "{"b" * 1000}"', "accepted as .columns. are"),
        ('name = "x"\n[columns]\na = "bread[g]"', "'bread' is no quantity"),
        ('name = "x"\n[columns]\na = "force_x[°]"', "'°' is no unit of force"),
        ('name = "x"\n[columns]\na = "time"\n[defaults]\nrate = "m"', "rate = 'm' is no quantity"),
        ('name = "x"\nsimulator = true\n[columns]\na = "roll"', "has no unit; accepted is one in brackets"),
        ('name = "x"\nsimulator = true\n[columns]\na = "wing[m]"', "'wing' is no quantity; accepted are"),
        ('name = "x"\nsimulator = true\n[columns]\na = "roll[m]"', "'m' is no unit of roll; accepted are"),
    ],
)
def test_what_is_wrong_is_named(own, text, words):
    path = own / "x.toml"
    path.write_text(text)
    with pytest.raises(MissionError, match=words):
        check_profile(read_profile(path))


def test_a_broken_profile_does_not_bar_other_files(own, tmp_path):
    (own / "broken.toml").write_text('name = "x"\nned = ["a"]')
    path = csv(tmp_path / "a.csv", head="time,lat,lon,alt")
    with pytest.warns(UserWarning, match="profile left out: .*broken.toml"):
        assert len(read_raw(path).time) == 60


@given(st.text(max_size=300), st.sampled_from(["name", "needs", "columns", "shared", "prefix"]))
def test_any_text_is_a_profile_or_refused(tmp_path_factory, text, key):
    path = tmp_path_factory.mktemp("hostile") / "x.toml"
    for content in (text, f"{key} = {text}", MINE + f"\n{text}"):
        path.write_text(content, "utf-8", errors="replace")
        try:
            check_profile(read_profile(path))
        except MissionError as error:
            assert str(path) in str(error)


def test_the_answer_of_a_person_is_kept_and_shared(own, tmp_path):
    path = csv(tmp_path / "a.csv", head="T,one,two,three")
    said = {"T": "time[ms]", "one": "latitude[1e-7°]", "two": "longitude[1e-7°]", "three": "height[cm]"}
    by_hand = read_raw(path, said)
    kept = save_profile("My own: logger/1", [path], said)
    assert kept.parent == own and kept.name == "my-own-logger-1.toml"
    by_profile = read_raw(path)
    for name in ("time", "latitude", "longitude", "height"):
        np.testing.assert_array_equal(getattr(by_profile, name), getattr(by_hand, name))
    assert columns_in(read_profile(kept), path)[0].startswith("Named by the profile: T = time[ms]")
    with pytest.raises(MissionError, match="is there already"):
        save_profile("My own: logger/1", [path], said)
    with pytest.raises(MissionError, match="needs the same headings"):
        save_profile("another", [path], said)
    with pytest.raises(MissionError, match="needs columns with headings"):
        save_profile("third", [path], {})


@pytest.mark.parametrize("unit", ["cm/s²", "mg"])
def test_what_the_data_do_not_decide_is_a_question_with_its_answers(own, tmp_path, unit):
    """Gravity of 981 may be 981 cm/s² or 981 mg with a bias; the answer is asked for once."""
    source = tables(30, 90)
    imu, gnss = source.imu.copy(), source.gnss[:, :6]
    imu[:, 4:] *= 100.0
    files = [tmp_path / "imu.csv", tmp_path / "gps.csv"]
    for file, head, rows in zip(
        files, ("t,wx,wy,wz,ax,ay,az", "t,lat,lon,alt,vn,ve"), (imu, gnss), strict=True
    ):
        file.write_text("\n".join((head, *(",".join(f"{x:.10g}" for x in row) for row in rows))))
    with pytest.raises(QuestionError) as asked:
        read_log(files)
    assert set(asked.value.choices) == {"cm/s²", "mg"}
    said = dict(asked.value.choices[unit])
    by_hand = read_log(files, said)
    save_profile("counts", files, said)
    np.testing.assert_array_equal(read_log(files).dvelocity, by_hand.dvelocity)
