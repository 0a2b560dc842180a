"""Profile check: whether a profile can be used, and the profile that a person's answers make."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from lab.base.files.atomic_file import write_file
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.files.profile import Profile, own_folder, own_profiles, plain, read_profile, shipped_profiles
from lab.data.files.unit_names import unit_of
from lab.data.sheets.column_names import (
    QUANTITIES,
    QUANTITIES_OF_FLIGHTS,
    given_heading,
    kind_of,
)
from lab.data.sheets.column_proposals import format_override
from lab.data.sheets.flight_columns import recognises_header
from lab.data.sheets.sensor_csv import sheets_of
from lab.data.sheets.sheet_layout import HEAD, as_utf8, find_layout, number_headings
from lab.data.sheets.sheet_sources import to_csv_table

_FILE_NAME = re.compile(r"[^\w-]+")


def check_profile(profile: Profile) -> None:
    """Raise if a profile cannot be used, or another one has the same files.

    Raises
    ------
    MissionError
        Naming the quantity or unit that is not accepted, or the other profile.
    """
    accepted = QUANTITIES_OF_FLIGHTS if profile.simulator else QUANTITIES
    for heading, text in profile.columns.items():
        try:
            found = given_heading(text, heading, accepted)
        except MissionError as error:
            raise MissionError(f"{profile.path}: {error}") from None
        if profile.simulator and found is not None and found.kind and not found.unit:
            raise MissionError(
                f"{profile.path}: {heading} = {text!r} has no unit; accepted is one in brackets: roll[°]"
            )
    for quantity, unit in profile.defaults.items():
        if not kind_of(quantity) or not unit_of(kind_of(quantity), unit):
            raise MissionError(
                f"{profile.path}: defaults: {quantity} = {unit!r} is no quantity with a unit; accepted is, "
                'for example, rate = "rad/s"'
            )
    for other in (*shipped_profiles(), *own_profiles()):
        same = set(other.needed) == set(profile.needed) and other.simulator == profile.simulator
        if same and other.path.resolve() != profile.path.resolve():
            raise MissionError(
                f"{profile.path}: {other.name} ({other.path}) needs the same headings, so a file would have "
                "two profiles; accepted is one. Let one of them need a heading that the other's files lack"
            )


def columns_in(profile: Profile, path: Path) -> list[str]:
    """Return sentences on which columns of a csv a profile names.

    Raises
    ------
    MissionError
        If the file cannot be read, or does not have this profile.
    """
    data = read_whole(path, MAX_BYTES)
    if profile.simulator:
        if not recognises_header(data[:HEAD], profile):
            raise MissionError(f"{path}: lacks headings that {profile.name} needs")
        return [f"{path}: is {profile.name}."]
    layout = find_layout(to_csv_table(as_utf8(data))[:HEAD], path.name)
    there = [] if layout is None else number_headings(layout.headings)
    if missing := profile.missing(there):
        seen = f"its headings are {', '.join(there)}" if there else "no headings are recognised in it"
        raise MissionError(f"{path}: lacks headings that {profile.name} needs: {', '.join(missing)}; {seen}")
    known = {text: profile.meanings[plain(text)][1] for text in there if plain(text) in profile.meanings}
    rest = [text for text in there if text and text not in known]
    named = [f"{text} = {meaning}" for text, meaning in known.items()]
    return [
        f"Named by the profile: {', '.join(named) or 'none'}.",
        f"Left to their headings: {', '.join(rest) or 'none'}.",
    ]


def save_profile(name: str, paths: Sequence[Path], units: Mapping[str, str]) -> Path:
    """Write what a person says of columns as a profile in the owner's folder; return the file.

    Parameters
    ----------
    name
        Name of the profile.
    paths
        The files whose columns they are.
    units
        What the person says, by heading.

    Raises
    ------
    MissionError
        If nothing is said, the columns have no headings, a profile of that name is there, or another profile
        has these headings.
    """
    if not units or all(heading.isdigit() for heading in units):
        raise MissionError(
            f"{name}: a profile needs columns with headings; accepted are --column HEADING=QUANTITY[UNIT] "
            "and --unit HEADING=UNIT"
        )
    columns: dict[str, str] = {}
    needs: list[str] = []
    for sheet in sheets_of(paths, units):
        named = {one.text: format_override(one, one.unit) for one in sheet.headings if one.text in units}
        named |= {text: "-" for text in sheet.unknown if text in units}
        if named:
            columns |= named
            needs += [*(one.text for one in sheet.headings), *sheet.unknown]
    path = own_folder() / f"{_FILE_NAME.sub('-', name).strip('-').lower() or 'profile'}.toml"
    if path.exists():
        raise MissionError(f"{path}: is there already; accepted is another name, or none of that file")
    text = profile_toml(name, list(dict.fromkeys(needs)), columns)
    profile = Profile(path, name, columns, tuple((one,) for one in dict.fromkeys(needs)))
    check_profile(profile)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, text)
    except OSError as error:
        raise MissionError(f"{path}: cannot be written: {error.strerror or error}") from error
    assert replace(read_profile(path), path=path) == profile
    return path


def profile_toml(name: str, needs: Sequence[str], columns: Mapping[str, str]) -> str:
    """Return the TOML of a profile; its strings are those of JSON, which TOML reads alike.

    Parameters
    ----------
    name
        Name of the profile.
    needs
        Headings that a file has to have.
    columns
        What each heading is, as ``--column`` takes it.
    """

    def quote_text(text: str) -> str:
        return json.dumps(text, ensure_ascii=False)

    lines = [f"{quote_text(heading)} = {quote_text(text)}" for heading, text in columns.items()]
    return "\n".join(
        (
            f"name = {quote_text(name)}",
            f"needs = [{', '.join(map(quote_text, needs))}]",
            "",
            "[columns]",
            *lines,
            "",
        )
    )
