"""``ins-lab sweep``: many seeds over values of settings, over cards and over missions."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli import options
from lab.cli.app import CommandError, argument, option, print_json, working, writing
from lab.cli.ensemble import format_beside, shown
from lab.cli.interrupt import STOPPED, interrupted
from lab.cli.terminal import format_list, paragraphs, table
from lab.missions import LogMission
from lab.missions import mission as find_mission

if TYPE_CHECKING:
    from lab.experiment.experiment import Experiment
    from lab.sensors.cards import Card as SensorCard

EXAMPLES = """\b
Examples:
  ins-lab sweep montreal --over navigator.q_scale=0.1:10:log:11 --seeds 50 --out sweep.nc
  ins-lab sweep montreal --over sensors.gps.period=1,2,5 --over navigator.model=phi,invariant
  ins-lab sweep montreal --over card=BMI270,STIM300 --fast
  ins-lab sweep --over mission=montreal,los_angeles --over card=all --json > cards.json
--over takes values separated by commas, LOW:HIGH:N for N values at equal distances, or LOW:HIGH:log:N at
equal ratios; several make a grid. A card brings its sensors and a filter that suits them; --set and other
settings override it. card=all stands for all cards. Errors are root mean squares over all runs and whole
flights; σ is that of the filter. NEES and NIS stand beside their expected values. Runs stay in no file but
that of --out. Ctrl-C shows, and writes, the runs that are done."""

SEEDS = 20
"""Number of runs of each combination unless another one is given; of a sensor log, there is one."""
MOST_POINTS = 10_000
"""Most combinations of values: each needs a copy of all settings."""
ACCEPTED = "accepted is PATH=A,B,C, PATH=LOW:HIGH:N or PATH=LOW:HIGH:log:N"


def sweep(
    over: Annotated[
        list[str],
        option("--over", "PATH=VALUES", "Values of a setting, of `card` or of `mission`; may be repeated."),
    ],
    mission: Annotated[
        str | None,
        argument(
            "MISSION",
            "Name of a mission, its .toml file, a flight csv, or the folder of a log; not needed with "
            "--over mission=NAME,...",
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        option(
            "--seeds",
            "N",
            "Number of runs of each combination, from --seed on.",
            f"{SEEDS}; 1 of a sensor log",
            min=1,
            max=options.MOST_RUNS,
        ),
    ] = None,
    config: options.Config = None,
    card: options.Card = None,
    assumed: options.Assumed = True,
    assignments: options.Assignments = None,
    seed: options.Seed = None,
    fast: options.Fast = False,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    out: Annotated[
        Path | None,
        option(
            "--out", "FILE", "Write the figures of each run: as netCDF to FILE.nc, as a table to FILE.csv."
        ),
    ] = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Navigate with values of settings, sensor cards or missions and many seeds; show the errors of each."""
    options.check_out(out, force, (".nc", ".csv"), "a netCDF file or a table", "--out")
    texts = _by_path(over)
    missions = [options.single_mission(name) for name in split_values("mission", texts.get("mission", ""))]
    if mission is None and not missions:
        raise CommandError("MISSION: is missing; accepted is a mission, or --over mission=NAME,...")
    first = missions[0] if mission is None else options.single_mission(mission)
    _check_conflicts(first, missions, card, assignments or [], texts)
    has_cards = "card" in texts
    chosen = base = options.experiment(first, config, card, assignments, seed, assumed or has_cards)
    if has_cards:  # as of `ins-lab run`: the file first, then the card, then --set
        base = options.experiment(first, config, None, None, chosen.seed)
    settings: dict[str, Sequence[Any]] = dict.fromkeys(texts, missions)
    for path, text in texts.items():
        if path != "mission":
            settings[path] = _cards(text, assumed) if path == "card" else parse_values(chosen, path, text)
    is_log = any(isinstance(find_mission(name), LogMission) for name in missions or [chosen.mission])
    count = seeds if seeds is not None else 1 if is_log else SEEDS
    runs = _checked_size(settings, count)
    from lab.experiment.ensembles import sweeping  # noqa: PLC0415 - takes a second

    began = time.monotonic()
    with (
        options.cluster_of(scheduler) as client,
        working(chosen.mission) as progress,
        interrupted() as pressed,
    ):
        found = sweeping.sweep(
            base,
            settings,
            count,
            progress,
            workers,
            fast=fast,
            fixed=_parse_settings(chosen, assignments or []) if has_cards else {},
            cancelled=pressed.is_set,
            client=client,
        )
    done = runs - found.missing
    facts = found.to_dict() | {
        "wanted": runs,
        "done": done,
        "remarks": _remarks(settings.get("card", ())) or list(filter(None, [chosen.sensors.card_remark()])),
        "seconds": time.monotonic() - began,
        "out": None if out is None else str(out),
    }
    if as_json:
        print_json(facts)
    else:
        print(paragraphs(_points(facts), format_list((*found.refused, *facts["remarks"]))))
    if out is not None:
        write = found.to_netcdf if out.suffix.lower() == ".nc" else found.to_csv
        with writing(out, "--out"):
            write(out, overwrite=force)
    if found.missing:
        print(f"ins-lab: stopped after {done:,} of {runs:,} runs", file=sys.stderr)
        raise typer.Exit(STOPPED)


def _by_path(over: Sequence[str]) -> dict[str, str]:
    """Return the texts of the values by the path of the setting."""
    found: dict[str, str] = {}
    for text in over:
        path, sign, values = (part.strip() for part in text.partition("="))
        if not (path and sign and values):
            raise CommandError(f"--over {text[:60]}: {ACCEPTED}")
        if path in found:
            raise CommandError(f"--over {path}: is there twice; accepted is one list of its values")
        if path == "seed":
            raise CommandError("--over seed: every sweep runs over seeds; --seeds N is their number")
        found[path] = values
    return found


def split_values(path: str, text: str) -> list[str]:
    """Return the values in a text that are separated by commas; commas in lists and quotes separate nothing.

    Raises
    ------
    CommandError
        If there is nothing between two commas.
    """
    parts, depth, quote = [""], 0, ""
    for sign in text:
        quote = "" if sign == quote else quote or (sign if sign in "\"'" else "")
        depth += 0 if quote else (sign == "[") - (sign == "]")
        if sign == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += sign
    parts = [_unquote_text(part.strip()) for part in parts] if text else []
    if not all(parts):
        raise CommandError(f"--over {path}={text[:60]}: a value between commas is empty; {ACCEPTED}")
    return parts


def _unquote_text(text: str) -> str:
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'" else text


def parse_values(chosen: Experiment, path: str, text: str) -> list[Any]:
    """Return the values of a setting that a text names: a list of them, or a range.

    Parameters
    ----------
    chosen
        The experiment.
    path
        Dotted path of the setting.
    text
        ``A,B,C``, ``LOW:HIGH:N`` or ``LOW:HIGH:log:N``; ranges are of numbers only.

    Raises
    ------
    SettingError, CommandError
        If there is no such setting, or no such value.
    """
    import param  # noqa: PLC0415 - help does not need it

    from lab.base.parameters.setting_error import SettingError  # noqa: PLC0415
    from lab.base.parameters.setting_kinds import AxisQuantity, QuantityOrNone  # noqa: PLC0415
    from lab.base.parameters.setting_text import value_of  # noqa: PLC0415

    declaration = chosen.declaration(path)
    if ":" in text and isinstance(declaration, param.Number | AxisQuantity | QuantityOrNone):
        return parse_range(path, text)
    parts = split_values(path, text)
    try:
        return [value_of(declaration, part) for part in parts]
    except ValueError as error:
        raise SettingError(f"--over {path}: {error}") from error


def parse_range(path: str, text: str) -> list[float]:
    """Return the numbers of a range, ends included, at equal distances or ratios.

    Parameters
    ----------
    path
        What has them, for messages.
    text
        ``LOW:HIGH:N`` or ``LOW:HIGH:log:N``.

    Raises
    ------
    CommandError
        If it is not such a range.
    """
    import numpy as np  # noqa: PLC0415 - help does not need it

    wrong = f"--over {path}={text[:60]}"
    low, high, *kind, number = (
        (part.strip() for part in text.split(":")) if text.count(":") in {2, 3} else [""] * 3
    )
    try:
        ends, count = (float(low), float(high)), int(number)
    except ValueError as error:
        raise CommandError(f"{wrong}: {ACCEPTED}, with numbers LOW and HIGH and a whole number N") from error
    if kind not in ([], ["log"]):
        raise CommandError(f"{wrong}: {':'.join(kind)} is no kind of range; {ACCEPTED}")
    if not np.isfinite(ends).all() or ends[0] == ends[1]:
        raise CommandError(f"{wrong}: accepted are two different numbers as LOW and HIGH")
    if not 2 <= count <= MOST_POINTS:
        raise CommandError(f"{wrong}: accepted are 2 to {MOST_POINTS:,} values")
    if kind and min(ends) <= 0:
        raise CommandError(f"{wrong}: equal ratios need LOW and HIGH above 0; LOW:HIGH:N has equal distances")
    values = np.geomspace(*ends, count) if kind else np.linspace(*ends, count)
    # Fourteen digits: 0.3 instead of 0.30000000000000004, so that other sweeps have the same values.
    return [ends[0], *(float(f"{value:.14g}") for value in values[1:-1]), ends[1]]


def _check_conflicts(
    mission: str,
    missions: Sequence[str],
    card: str | None,
    assignments: Sequence[str],
    swept: Mapping[str, str],
) -> None:
    """Raise `CommandError` if something is given once and swept as well."""
    if missions and mission not in missions:
        raise CommandError(f"{mission}: --over mission does not name it; leave it out, or add it there")
    if card is not None and "card" in swept:
        raise CommandError("--card: --over card names the cards; accepted is one of the two")
    for path in (text.partition("=")[0].strip() for text in assignments):
        if path in swept:
            raise CommandError(f"--set {path}: --over names its values; accepted is one of the two")


def _cards(text: str, assumed: bool) -> list[SensorCard]:
    """Return the named cards; ``all`` stands for all of the catalogue."""
    from lab.sensors.cards import card, cards  # noqa: PLC0415 - rarely needed

    names = split_values("card", text)
    return [card(name, assumed=assumed) for name in (cards() if names == ["all"] else names)]


def _remarks(cards: Sequence[SensorCard]) -> list[str]:
    """Return what each card assumes and lacks: with a short sheet, a sensor looks better than it is."""
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - help does not need it

    found = {card.name: SensorSuite().update(card.settings()).card_remark() for card in cards}
    return [f"{name}: {remark}" for name, remark in found.items() if remark]


def _parse_settings(chosen: Experiment, assignments: Sequence[str]) -> dict[str, Any]:
    """Return the settings of --set, which override those of a card."""
    paths = (text.partition("=")[0].strip() for text in assignments)
    return {path: chosen.get(path) for path in paths if path not in {"mission", "seed"}}


def _checked_size(settings: Mapping[str, Sequence[Any]], seeds: int) -> int:
    """Return the number of runs; `CommandError` if there are too many."""
    points = math.prod(len(values) for values in settings.values())
    if points > MOST_POINTS:
        raise CommandError(f"--over: makes {points:,} combinations of values; accepted are {MOST_POINTS:,}")
    if points * seeds > options.MOST_RUNS:
        raise CommandError(f"--seeds: makes {points * seeds:,} runs; accepted are {options.MOST_RUNS:,}")
    return points * seeds


def _points(facts: Mapping[str, Any]) -> str:
    """Return a row for each combination of values."""
    swept = facts["swept"]
    titles = [_column_title(one["setting"].split(".")[-1], one["unit"]) for one in swept]
    errors = [(name, facts["points"][0][name]["unit"]) for name in ("position", "velocity", "heading")]
    titles += [
        title for name, unit in errors for title in (_column_title(name, unit), _column_title("σ", unit))
    ]
    titles += ["95 % [m]", "NEES", "NIS", "runs"]
    rows = [
        (
            *(_value(point["values"][one["setting"]]) for one in swept),
            *(shown(point[name][figure]) for name, _ in errors for figure in ("rms", "sigma")),
            shown(point["horizontal_95"]),
            *(format_beside(point[name]) for name in ("nees", "nis")),
            str(point["runs"]),
        )
        for point in facts["points"]
    ]
    texts = {at for at, one in enumerate(swept) if isinstance(one["values"][0], str)}
    return table(titles, rows, right=set(range(len(titles))) - texts)


def _value(value: Any) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"


def _column_title(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name
