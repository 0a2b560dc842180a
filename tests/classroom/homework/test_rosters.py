"""Rosters of learning platforms, and what goes back to them: points, and feedback for each student."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.classroom.homework.feedback import check_new, feedback_text, write_feedback
from lab.classroom.homework.gradebooks import canvas_text, collect_points, moodle_text
from lab.classroom.homework.grading import (
    GRADED,
    REFUSED,
    GradingError,
    Row,
    columns,
    grade,
    list_files,
    text_cell,
    unguard_cell,
)
from lab.classroom.homework.hand_in import hand_in, write_hand_in
from lab.classroom.homework.homework_file import Keyed, make_homework
from lab.classroom.homework.roster import CANVAS, MOODLE, NAMES, RosterError, read_roster, roster_of

OF_CANVAS = """Student,ID,SIS User ID,SIS Login ID,Section,Find it (77),Other (78)
    Points Possible,,,,,8.00,2
,,,,,Manual Posting,
"Lovelace, Ada",11,u11,ada@x.org,Group A,,1
"Müller, Bob",12,u12,bob@x.org,Group A,3.00,
"Student, Test",99,,,Group A,,
"""
OF_MOODLE = """First name,Last name,ID number,Email address
Ada,Lovelace,11,ada@x.org
Bob,Müller,12,bob@x.org
"""
WORKSHEET = """Identifier,Full name,Email address,Grade,Maximum Grade,Last modified (grade),Feedback comments
Participant 501,Ada Lovelace,ada@x.org,,8,-,
Participant 502,Bob Müller,bob@x.org,-,8,-,
"""


def row(name: str, points: str = "7.5", status: str = GRADED, file: str = "a.handin") -> Row:
    return {"name": text_cell(name), "points": points, "status": status, "file": text_cell(file)}


def table(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (OF_CANVAS, CANVAS),
        (OF_CANVAS.replace("Student,ID", "LastName,FirstName,ID").replace('"Lovelace, Ada"', "Lovelace,Ada")
         .replace('"Müller, Bob"', "Müller,Bob").replace('"Student, Test"', "Student,Test")
         .replace("Possible,,", "Possible,,,").replace("\n,,", "\n,,,"), CANVAS),
        (OF_MOODLE, MOODLE),
        (OF_MOODLE.replace(",", ";"), MOODLE),
        (OF_MOODLE.replace(",", "\t").replace("Last name", "Surname"), MOODLE),
        (WORKSHEET, MOODLE),
        ("Name\nAda Lovelace\n\nBob  Müller\n", NAMES),
        ('name,group\r\n"Lovelace, Ada",1\r\n"Müller, Bob"\r\n', NAMES),
    ],
)  # fmt: skip
def test_exports_of_platforms_give_the_same_names(tmp_path: Path, text: str, kind: str) -> None:
    path = tmp_path / "class.csv"
    for mark in ("", "\ufeff"):
        path.write_text(mark + text, encoding="utf-8")
        roster = read_roster(path)
        assert roster.kind == kind
        assert [student.name for student in roster.students] == ["Ada Lovelace", "Bob Müller"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no headings"),
        ("points,mail\n1,2\n", "points, mail"),
        ("Name\n", "no students"),
        ('Name\n"Ada\n', "no csv"),
        ("Name\nAda,Bob\n", "line 2 has 2 cells"),
        ("Name\n" + "x" * 81, "line 2"),
        ("Name\n" + "\n".join(map(str, range(2001))), "2001 students"),
    ],
)
def test_what_is_no_roster_is_refused_in_words(text: str, words: str) -> None:
    with pytest.raises(RosterError, match=words):
        roster_of(text)


def test_files_that_are_no_text_or_too_large_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"Name\nM\xfcller\n")
    (tmp_path / "b.csv").write_bytes(b"Name\n" + b"x\n" * 1_000_001)
    for name, words in (("a.csv", "UTF-8"), ("b.csv", "2 MB"), ("c.csv", "cannot be read")):
        with pytest.raises(RosterError, match=words):
            read_roster(tmp_path / name)


@given(st.text(max_size=300))
def test_any_text_is_a_roster_or_refused(text: str) -> None:
    try:
        roster = roster_of(text)
    except RosterError:
        return
    assert roster.students
    assert all(one.name.isprintable() and one.name == " ".join(one.name.split()) for one in roster.students)


def test_canvas_gets_its_own_columns_points_possible_and_the_number_of_the_assignment() -> None:
    roster = roster_of(OF_CANVAS)
    points = collect_points([row("ada  LOVELACE")], roster)
    text = canvas_text(roster, points, "Find it", 8.0)
    assert text.splitlines()[0] == "Student,ID,SIS User ID,SIS Login ID,Section,Find it (77)"
    possible, ada, bob = table(text)
    assert possible["Student"].strip() == "Points Possible"
    assert (possible["Find it (77)"], ada["Find it (77)"], bob["Find it (77)"]) == ("8", "7.5", "3.00")
    assert (ada["Student"], ada["ID"], ada["SIS Login ID"]) == ("Lovelace, Ada", "11", "ada@x.org")
    assert "New work" in canvas_text(roster, points, "New work", 8.0).splitlines()[0]


def test_moodle_gets_its_worksheet_filled_in_or_a_table_to_map() -> None:
    sheet = roster_of(WORKSHEET)
    text = moodle_text(sheet, collect_points([row("Ada Lovelace")], sheet), "Find it")
    ada, bob = table(text)
    assert text.splitlines()[0] == WORKSHEET.splitlines()[0]
    assert (ada["Grade"], bob["Grade"]) == ("7.5", "-")
    assert (ada["Identifier"], ada["Last modified (grade)"]) == ("Participant 501", "-")
    people = roster_of(OF_MOODLE)
    ada, bob = table(moodle_text(people, collect_points([row("Ada Lovelace")], people), "Find it"))
    assert ada == {
        "First name": "Ada", "Last name": "Lovelace", "ID number": "11", "Email address": "ada@x.org",
        "Find it": "7.5",
    }  # fmt: skip
    assert bob["Find it"] == ""


def test_a_roster_of_another_platform_is_refused() -> None:
    canvas, moodle, names = map(roster_of, (OF_CANVAS, OF_MOODLE, "Name\nAda\n"))
    for roster in (canvas, names):
        with pytest.raises(RosterError, match="Email"):
            moodle_text(roster, collect_points([], roster), "x")
    for roster in (moodle, names):
        with pytest.raises(RosterError, match="Section"):
            canvas_text(roster, collect_points([], roster), "x", 1.0)


def test_points_without_a_single_owner_are_left_out_with_the_reason() -> None:
    roster = roster_of("Name\nAda\nBob\nEve\nEve\n")
    rows = [
        row("Ada", file="1"), row("ada", file="2"), row("Bob"), row("Eve"), row("Zoe"),
        row("Bob", status=REFUSED),
    ]  # fmt: skip
    points = collect_points(rows, roster)
    assert points.by_name == {"bob": "7.5"}
    assert [remark.partition(":")[0] for remark in points.remarks] == ["Ada", "Eve", "Zoe"]
    assert "1, 2" in points.remarks[0]


@pytest.mark.parametrize("sign", "=+-@＝\t")
def test_no_name_becomes_a_formula(sign: str) -> None:
    """A student chose the name in the platform, and a teacher opens the table in a spreadsheet."""
    evil = f"{sign}cmd|'/C calc'!A0"
    for text in (
        OF_CANVAS.replace('"Lovelace, Ada"', f'"{evil}"').replace("u11", evil),
        OF_MOODLE.replace("Lovelace", evil).replace("ada@x.org", evil),
        WORKSHEET.replace("Ada Lovelace", evil),
    ):
        roster = roster_of(text)
        points = collect_points([], roster)
        title = f"{sign}1+1"
        written = (
            canvas_text(roster, points, title, 8.0)
            if roster.kind == CANVAS
            else moodle_text(roster, points, title)
        )
        cells = [cell for line in csv.reader(io.StringIO(written)) for cell in line]
        assert any("cmd|" in cell for cell in cells)
        risky = [cell for cell in cells if cell.lstrip().startswith(("=", "+", "-", "@", "＝"))]
        assert risky in ([], ["-"] * len(risky))


@given(st.text(max_size=40))
def test_a_guard_is_taken_off_again(text: str) -> None:
    plain = "".join(sign if sign.isprintable() else "�" for sign in text)
    cell = text_cell(text)
    assert unguard_cell(cell) == plain or plain.startswith("'")


SOURCE = """title = "Find it"
text = "Something."
fault_points = 2
[settings]
mission = "los_angeles"
trajectory.imu_rate = 20
[hidden]
faults = ["latency"]
[[question]]
text = "How old?"
answer = -0.0437
tolerance = 0.001
points = 3
[[question]]
text = "Colour?"
choices = ["white", "pink"]
answer = "pink"
[[goal]]
text = "NEES is small."
condition = "nees < 1e9"
"""


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Keyed:
    path = tmp_path_factory.mktemp("source") / "find.toml"
    path.write_text(SOURCE, encoding="utf-8")
    return make_homework(path)


def test_feedback_has_the_path_of_the_hand_in_and_tells_no_solution(keyed: Keyed, tmp_path: Path) -> None:
    handed, out = tmp_path / "handed", tmp_path / "feedback"
    sent = handed / "Ada Lovelace_501_assignsubmission_file"
    sent.mkdir(parents=True)
    begun = keyed.homework.experiment()
    faults = ("fixes that come late",)
    write_hand_in(
        sent / "ada.handin",
        keyed.homework,
        hand_in(keyed.homework, "Ada", begun, faults, ("-0.0437", "white")),
    )
    (handed / "broken.handin").write_text("nothing", encoding="utf-8")
    files = list_files(handed)
    rows = grade(files, keyed)
    check_new(out)
    assert write_feedback(out, handed, files, rows, keyed) == 2
    text = (out / "Ada Lovelace_501_assignsubmission_file/ada.handin.feedback.txt").read_text("utf-8")
    for words in (
        "Points: 6 of 7", "You answered: -0.0437 (right)", "You answered: white (not right)",
        "Hidden faults: 2 of 2", "NEES is small. (reached)", "nees: ",
    ):  # fmt: skip
        assert words in text
    assert "pink" not in text
    assert "not graded: it is not a hand-in" in (out / "broken.handin.feedback.txt").read_text("utf-8")
    with pytest.raises(GradingError, match="not empty"):
        check_new(out)


def test_feedback_on_settings_that_do_not_run_says_why(keyed: Keyed) -> None:
    cells = dict.fromkeys(columns(keyed.judge), "") | {
        "file": "a", "status": "not run", "remark": "cannot be run: no", "name": "Ada", "points": "0",
        "of": "7",
        "answer_points_1": "0", "answer_points_2": "0", "goal_1_points": "0", "faults_points": "0",
    }  # fmt: skip
    assert "They were not run: cannot be run: no." in feedback_text(cells, keyed.homework)
