"""``ins-lab homework``: make a homework; read it, work with it, and hand it in."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from lab.base.files.atomic_file import write_file
from lab.base.parameters.counted import count_noun
from lab.cli.app import CommandError, argument, group, option, print_json, working
from lab.cli.options import AsJson, Assignments, Config, Force, Seed, check_out

if TYPE_CHECKING:
    from lab.classroom.homework.hidden_experiment import HiddenExperiment
    from lab.classroom.homework.homework import Homework

EXAMPLES = """\b
Examples:
  ins-lab homework make receiver.toml --out receiver.homework
  ins-lab homework show receiver.homework
  ins-lab homework run receiver.homework --set navigator.latency=0.1
  ins-lab homework hand-in receiver.homework --name "Ada Lovelace" \\
      --set navigator.latency=0.1 --fault "fixes that come late" --out ada.handin
  ins-lab homework variants receiver.key --roster class.csv --out variants
  ins-lab homework solutions receiver.key --out solutions.html
  ins-lab grade handed_in --key receiver.key --out grades.csv
  ins-lab serve --homework my_keys"""

homework = group("homework")

TheHomework = Annotated[Path, argument("FILE", "The homework, a .homework file.")]


TheKey = Annotated[Path, argument("FILE.key", "The key of the homework.")]
RosterFile = Annotated[
    Path | None,
    option(
        "--roster", "FILE.csv", "The students, as Moodle or Canvas exports them, or a csv with a column Name."
    ),
]


@homework.command("make")
def make(
    source: Annotated[Path, argument("HOMEWORK.toml", "The homework as you wrote it.")],
    out: Annotated[Path, option("--out", "FILE.homework", "The file for the students.")],
    key: Annotated[
        Path | None,
        option(
            "--key",
            "FILE.key",
            "The key, which you keep; by default beside the other file. It is never replaced.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Make a homework: a file for the students, and a key for you, which contains the solutions."""
    from lab.classroom.homework.homework_file import homework_text, make_homework, write_key  # noqa: PLC0415 - slow

    check_out(out, force, ".homework", "a homework", "--out")
    kept = out.with_suffix(".key") if key is None else key
    if kept.suffix != ".key":
        raise CommandError(f"--key {kept}: accepted is the name of a key, ending in .key")
    made = _read(lambda: make_homework(source))
    try:
        write_key(kept, made)
    except FileExistsError as error:
        raise CommandError(
            f"--key {kept}: exists already, and a key is never replaced: it grades what was handed in; name "
            "another one with --key"
        ) from error
    if made.varies:
        print(f"{kept}: for you alone: it contains the solutions, and `ins-lab grade` needs it")
        print(
            f"{out}: not written, because each student gets a file of their own: "
            f"ins-lab homework variants {kept} --roster class.csv --out {out.with_suffix('')}"
        )
        return
    try:
        write_file(out, homework_text(made))
    except BaseException:
        kept.unlink()  # it grades nothing, and would refuse the next attempt
        raise
    print(f"{out}: for the students: {made.homework.title} ({made.homework.name})")
    print(f"{kept}: for you alone: it contains the solutions, and `ins-lab grade` needs it")


@homework.command("variants")
def variants(
    key: TheKey,
    out: Annotated[Path, option("--out", "FOLDER", "A new folder for the files.")],
    roster: RosterFile = None,
    names: Annotated[list[str] | None, option("--name", "NAME", "A student; may be repeated.")] = None,
) -> None:
    """Write the homework of each student, with hidden values of their own, and a table of links."""
    from lab.classroom.homework.hand_out import LINKS, handed_out, links_text  # noqa: PLC0415 - slow
    from lab.classroom.homework.homework_file import homework_text, read_key  # noqa: PLC0415 - slow

    keyed = _read(lambda: read_key(key))
    if not keyed.varies:
        raise CommandError(f"{key}: has no table hidden.each, so all students get the same homework")
    students = [*(_roster_names(roster) if roster is not None else []), *(names or [])]
    if not students:
        raise CommandError("no students; accepted are --roster FILE.csv, --name NAME, or both")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise CommandError(f"--out {out}: is not empty; accepted is a new folder")
    made = _read(lambda: handed_out(keyed, students))
    out.mkdir(parents=True, exist_ok=True)
    for one in made:
        write_file(out / one.file, homework_text(keyed, one.name))
    write_file(out / LINKS, codecs.BOM_UTF8 + links_text(made).encode())
    print(
        f"{out}: {count_noun(len(made), 'file')} for {keyed.homework.title}, one for each student, and "
        f"{LINKS}"
    )


@homework.command("solutions")
def solutions(
    key: TheKey,
    out: Annotated[Path, option("--out", "FILE.html", "The sheet.")],
    roster: RosterFile = None,
    force: Force = False,
) -> None:
    """Write everything that a key knows as one page to print: for teachers only."""
    from lab.classroom.homework.homework_file import read_key  # noqa: PLC0415 - slow
    from lab.classroom.homework.solutions_sheet import solutions_html  # noqa: PLC0415 - slow

    check_out(out, force, ".html", "a page", "--out")
    keyed = _read(lambda: read_key(key))
    text = _read(lambda: solutions_html(keyed, _roster_names(roster) if roster is not None else ()))
    write_file(out, text)
    print(f"{out}: solutions of {keyed.homework.title}; print it from a browser")


@homework.command("show")
def show(file: TheHomework, as_json: AsJson = False) -> None:
    """Show a homework: its text, its questions, and which settings you may change."""
    found = _open(file)
    if as_json:
        print_json(_facts(found))
        return
    lines = [f"{found.title} ({found.name})", "", found.text, ""]
    if found.student:
        lines += [f"This file is for {found.student}: the hidden values of others differ.", ""]
    lines += ["You may change: " + (", ".join(found.scenario.change) or "nothing"), ""]
    if found.names_faults:
        lines += [f"Which faults are hidden? ({_points(found.fault_points)}) --fault takes any of:"]
        lines += [f"  {title}" for title in _titles()]
    for number, question in enumerate(found.questions, 1):
        lines += ["", f"{number}. {question.text} ({_points(question.points)})"]
        lines += [f"  {choice}" for choice in question.choices]
    goals = [goal for goal in found.goals if goal.text]
    if goals:
        lines += ["", "The result of your settings should reach:"]
        lines += [f"  {goal.text} ({_points(goal.points)})" for goal in goals]
    print("\n".join(lines))


@homework.command("run")
def run(
    file: TheHomework,
    config: Config = None,
    assignments: Assignments = None,
    seed: Seed = None,
    out: Annotated[Path | None, option("--out", "FILE.nc", "Write the whole result as netCDF.")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Navigate the flight of a homework with your settings; show the errors and the verdict."""
    from lab.cli.run import json_facts, report, write_result  # noqa: PLC0415 - slow

    check_out(out, force, ".nc", "a netCDF file", "--out")
    chosen = _experiment(_open(file), config, assignments)
    if seed is not None:
        chosen.set("seed", seed)
    with working(file.name) as progress:
        result = chosen.run(progress)
        if out is not None:
            write_result(result, out, force)
        if as_json:
            found = json_facts(result, (), progress, out=out, export=None)
        verdict = result.tried_verdict
    if as_json:
        print_json(found)
    else:
        print(report(result, verdict))


@homework.command("hand-in")
def hand_in(
    file: TheHomework,
    name: Annotated[str, option("--name", "NAME", "Your name.")],
    out: Annotated[Path, option("--out", "FILE.handin", "The file that you hand in.")],
    config: Config = None,
    assignments: Assignments = None,
    faults: Annotated[
        list[str] | None, option("--fault", "TITLE", "A fault that is hidden; may be repeated.")
    ] = None,
    answers: Annotated[
        list[str] | None, option("--answer", "N=ANSWER", "The answer to question N; may be repeated.")
    ] = None,
    force: Force = False,
) -> None:
    """Write the file that you hand in: your name, your settings and your answers, sealed for the teacher."""
    from lab.classroom.homework.hand_in import SUFFIX, HandInError, write_hand_in  # noqa: PLC0415 - slow
    from lab.classroom.homework.hand_in import hand_in as made  # noqa: PLC0415 - slow

    check_out(out, force, SUFFIX, "a hand-in", "--out")
    found = _open(file)
    if any(text.partition("=")[0].strip() == "seed" for text in assignments or ()):
        raise CommandError(
            "--set seed: the seed is not handed in, because the grader takes that of the homework; `ins-lab "
            "homework run` accepts another one"
        )
    chosen = _experiment(found, config, assignments)
    try:
        handed = made(found, name, chosen, tuple(faults or ()), _answers(found, answers or ()))
    except HandInError as error:
        raise CommandError(f"the hand-in {error}") from error
    write_hand_in(out, found, handed, overwrite=force)
    print(f"{out}: {handed.name}, {found.title}")
    changed = ", ".join(f"{path}={value}" for path, value in handed.changes.items())
    print(f"settings: {changed or 'as in the homework'}")
    if chosen.seed != found.scenario.shown.seed:
        print(f"The seed {chosen.seed} of {config} is not handed in: the grader takes that of the homework.")
    if found.names_faults:
        print(f"faults: {', '.join(handed.faults) or 'none'}")
    for number, answer in enumerate(handed.answers, 1):
        print(f"answer {number}: {answer or 'none'}")


def _roster_names(path: Path) -> list[str]:
    """Return the names of a roster; two students with one name would have one variant."""
    from lab.classroom.homework.roster import RosterError, read_roster  # noqa: PLC0415 - slow

    try:
        roster = read_roster(path)
    except RosterError as error:
        raise CommandError(f"--roster {error}") from error
    if same := roster.same_names():
        raise CommandError(
            f"--roster {path}: {', '.join(same)}: more than one student has this name; accepted are "
            "different names, because the hidden values follow from the name"
        )
    return [student.name for student in roster.students]


def _open(file: Path) -> Homework:
    from lab.classroom.homework.homework_file import read_homework  # noqa: PLC0415 - slow

    found: Homework = _read(lambda: read_homework(file))
    return found


def _read(reading: Any) -> Any:
    """Return what is read; a problem becomes a message."""
    from lab.classroom.homework.sealing import SealError  # noqa: PLC0415 - slow
    from lab.classroom.lessons.fields import LessonError  # noqa: PLC0415 - slow

    try:
        return reading()
    except (LessonError, SealError) as error:
        raise CommandError(str(error)) from error


def _experiment(found: Homework, config: Path | None, assignments: Sequence[str] | None) -> HiddenExperiment:
    """Return the experiment with the student's settings."""
    from lab.base.parameters.setting_error import SettingError  # noqa: PLC0415 - beside the others
    from lab.base.parameters.toml_file import TomlError, read_toml  # noqa: PLC0415 - beside the others

    chosen = found.experiment()
    if config is not None:
        try:
            chosen.update(read_toml(config))
        except (TomlError, SettingError) as error:
            raise CommandError(f"{config}: {error}") from error
    chosen.set_texts(assignments or [])
    found.scenario.changes(chosen)
    return chosen


def _answers(found: Homework, given: Sequence[str]) -> tuple[str, ...]:
    """Return the answers in the order of the questions."""
    answers = [""] * len(found.questions)
    for text in given:
        number, sign, answer = text.partition("=")
        if not sign or not number.strip().isdecimal() or not 1 <= int(number) <= len(answers):
            raise CommandError(
                f"--answer {text[:60]}: accepted is N=ANSWER, with N from 1 to {len(answers)}"
                if answers
                else f"--answer {text[:60]}: this homework has no questions besides the faults"
            )
        answers[int(number) - 1] = answer.strip()
    return tuple(answers)


def _titles() -> tuple[str, ...]:
    from lab.classroom.homework.homework import fault_titles  # noqa: PLC0415 - slow

    return fault_titles()


def _points(points: float) -> str:
    return f"{points:g} point{'' if points == 1 else 's'}"


def _facts(found: Homework) -> dict[str, Any]:
    return {
        "title": found.title,
        "name": found.name,
        "student": found.student,
        "text": found.text,
        "settings": dict(found.scenario.settings),
        "change": list(found.scenario.change),
        "faults": list(_titles()) if found.names_faults else None,
        "questions": [
            {"text": one.text, "choices": list(one.choices), "points": one.points} for one in found.questions
        ],
        "goals": [{"text": one.text, "points": one.points} for one in found.goals],
        "points": found.best,
    }
