"""``ins-lab profile``: what the columns of a maker's csv are, listed and checked."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from lab.base.parameters.counted import count_noun
from lab.cli.app import argument, group, print_json
from lab.cli.options import AsJson
from lab.cli.terminal import table

EXAMPLES = """\b
Examples:
  ins-lab profile list
  ins-lab profile propose flight.csv
  ins-lab profile check my_logger.toml
  ins-lab profile check my_logger.toml flight.csv
  ins-lab import flight.csv --column a1=force_x[g] --save-profile "My logger"
A profile names the columns of a csv, as --column does. Files in the folder that the list names are used
for every csv that has their headings."""

profile = group("profile")


@profile.command("list")
def list_profiles(as_json: AsJson = False) -> None:
    """List the profiles that ship with the lab, and your own."""
    from lab.data.files.profile import own_folder, own_profiles, shipped_profiles  # noqa: PLC0415 - reads them

    found = [(one, "the lab") for one in shipped_profiles()] + [(one, "you") for one in own_profiles()]
    if as_json:
        print_json(
            [
                {"name": one.name, "file": str(one.path), "of": of, "columns": dict(one.columns)}
                for one, of in found
            ]
        )
        return
    rows = [(one.name, str(len(one.columns)), of, one.path.name) for one, of in found]
    print(table(("name", "columns", "of", "file"), rows))
    print(f"Your own: {own_folder()}")


@profile.command("propose")
def propose(
    files: Annotated[list[Path], argument("CSV...", "The files.")],
    as_json: AsJson = False,
) -> None:
    """List what each column of a csv is taken for, with the evidence: the options that say it otherwise."""
    from lab.data.sheets.column_proposals import column_proposals  # noqa: PLC0415 - imports scipy

    found = column_proposals(files)
    if as_json:
        print_json([asdict(one) for one in found])
        return
    rows = [(f"{one.heading}={one.said}", "?" if one.unsure else "", one.evidence, one.file) for one in found]
    print(table(("--column", "guessed", "evidence", "file"), rows))


@profile.command("check")
def check(
    file: Annotated[Path, argument("FILE", "The profile.")],
    csv: Annotated[Path | None, argument("[CSV]", "A file that should have this profile.")] = None,
) -> None:
    """Check a profile: quantities, units, other profiles for the same files, and a csv if one is given."""
    from lab.data.files.profile import read_profile  # noqa: PLC0415 - beside what it goes with
    from lab.data.sheets.profile_check import check_profile, columns_in  # noqa: PLC0415 - imports scipy

    read = read_profile(file)
    check_profile(read)
    needs = ", ".join(" or ".join(one) for one in read.needs)
    lines = columns_in(read, csv) if csv is not None else []
    print(f"{read.name}: {count_noun(len(read.columns), 'column')}, needs {needs}.")
    for line in lines:
        print(line)
