"""``ins-lab scoreboard``: public data sets, navigated by the lab and by other programs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.base.files.mission_error import MissionError
from lab.base.parameters.setting_error import SettingError
from lab.cli.app import CommandError, argument, option, print_json, working, writing
from lab.cli.options import AsJson
from lab.cli.terminal import table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lab.experiment.scoreboard.comparison import Row
    from lab.experiment.scoreboard.registry import DataSet

EXAMPLES = """\b
Examples:
  ins-lab scoreboard
  ins-lab scoreboard kf_gins
  ins-lab scoreboard --data recordings
  ins-lab scoreboard rtkx_walk --data recordings --keep results.json
Nothing is fetched: FOLDER has a folder of its name for each set. python-ins and sidereon navigate the same
data where they are installed: pip install 'ins-lab[peers]'. docs/scoreboard.md has the results."""


def scoreboard(
    name: Annotated[str | None, argument("[NAME]", "Data set; all by default.")] = None,
    data: Annotated[
        Path | None,
        option(
            "--data",
            "FOLDER",
            "Folder with a folder of each set, or that of one; without it, kept results are shown.",
        ),
    ] = None,
    keep: Annotated[
        Path | None,
        option("--keep", "FILE.json", "File of results to renew: rows are replaced, and none is removed."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Navigate public data sets with the lab and with other programs, and show who is ahead."""
    from lab.experiment.scoreboard.registry import data_set, data_sets  # noqa: PLC0415 - help loads no TOML

    chosen = list(data_sets().values()) if name is None else [data_set(name)]
    if keep is not None and data is None:
        raise CommandError("--keep: there is nothing new to keep; accepted with --data FOLDER")
    if keep is not None and keep.suffix != ".json":
        raise CommandError(f"--keep {keep}: accepted is a JSON file, whose name ends with .json")
    if data is None:
        from lab.experiment.scoreboard.results import kept_rows, of_set  # noqa: PLC0415 - likewise

        kept = kept_rows()
        _print_tables([(about, of_set(kept, about.name)) for about in chosen], as_json)
        return
    _run(chosen, data, keep, as_json, wanted=name is not None)


def _run(chosen: Sequence[DataSet], data: Path, keep: Path | None, as_json: bool, *, wanted: bool) -> None:
    """Navigate the sets that are there, show their rows, and keep them."""
    import sys  # noqa: PLC0415 - here alone
    from tempfile import TemporaryDirectory  # noqa: PLC0415 - likewise

    from lab.experiment.scoreboard.comparison import compare, describe_source, find_folder  # noqa: PLC0415 - slow
    from lab.experiment.scoreboard.results import kept_rows, known_files, merge_rows, write  # noqa: PLC0415

    if not data.is_dir():
        what = "is a file" if data.is_file() else "there is no such folder"
        raise CommandError(f"--data {data}: {what}; accepted is a folder with folders of the sets")
    there = {about.name: find_folder(about, data, alone=wanted) for about in chosen}
    absent = [about for about in chosen if there[about.name] is None]
    if len(absent) == len(chosen):
        names = ", ".join(about.name for about in chosen)
        where = f"; {describe_source(chosen[0])}" if wanted else ""
        raise CommandError(f"--data {data}: has no set; accepted are folders in it named {names}{where}")
    old = kept_rows(keep) if keep is not None and keep.exists() else []
    known = old or kept_rows()
    found: list[tuple[DataSet, list[Row]]] = []
    refused: list[ValueError] = []
    for about in chosen:
        folder = there[about.name]
        if folder is None:
            continue
        try:
            with working(about.name) as progress, TemporaryDirectory() as library:
                rows = compare(about, folder, Path(library), progress, known_files(known, about.name))
        except (CommandError, MissionError, SettingError) as error:
            refused.append(error)
            continue
        found.append((about, rows))
    if not found:
        raise refused[0]
    _print_tables(found, as_json)
    for reason in refused:
        print(f"ins-lab: {reason}", file=sys.stderr)
    for about in absent:
        print(f"ins-lab: {about.name} is not in {data}: {describe_source(about)}", file=sys.stderr)
    if keep is not None:
        with writing(keep, "--keep"):
            write(keep, merge_rows(old, [row for _, rows in found for row in rows]))
    if refused:
        raise typer.Exit(2)


def _print_tables(found: Sequence[tuple[DataSet, Sequence[Row]]], as_json: bool) -> None:
    """Print the tables of some sets, each followed by what it rests on."""
    from lab.experiment.scoreboard.results import describe_standing, list_notes, program_notes, tabulate_rows  # noqa: PLC0415

    if as_json:
        data = [
            {
                "data": about.name,
                "source": about.source,
                "licence": about.licence,
                "protocol": about.protocol._asdict(),
                "published": [one._asdict() for one in about.published],
                "standing": dict(zip(("sentence", "rests_on"), describe_standing(about, rows), strict=True)),
                "rows": [row._asdict() for row in rows],
            }
            for about, rows in found
        ]
        print_json({"schema": "ins-lab scoreboard answer", "schema_version": 1, "sets": data})
        return
    parts = []
    for about, rows in found:
        titles, lines = tabulate_rows(about, rows)
        sentence, basis = describe_standing(about, rows)
        parts.append(
            f"{about.name}: {about.title}\n{about.source}, {about.licence}\n\n"
            + table(titles, lines, right=set(range(1, len(titles))))
            + f"\n\n{sentence}\n  [{basis}]\n"
            + "\n".join(f"  {note}" for note in list_notes(about))
        )
    notes = program_notes([row for _, rows in found for row in rows])
    print("\n\n".join((*parts, "\n".join(notes))).rstrip())
