"""Labelled lines: samples with words between the numbers, on one line or on several.

Sketches of microcontrollers write ``Accel X: 0.12  Y: 0.40  Z: 9.80 m/s^2`` and a line for the gyros after
it, ``Scaled. Acc (mg) [ 12.20, 3.10, 1000.00 ], Gyr (DPS) [ …``, ``ax:0.10,ay:0.02``, a heading and three
lines below it, or JSON. The lines of a sample are those that repeat. What stands before a number is its
name, what stands behind it its unit, and a name holds for the numbers that follow without one.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.files.unit_names import UNITS, unit_of
from lab.data.protocols.column_map import MAX_COLUMNS
from lab.data.protocols.line_sources import names_a_device
from lab.data.protocols.text_cells import Cells, cells_in
from lab.data.sheets.column_names import heading_of

PERIODS = 3
"""Samples that must have followed each other in the same lines: two may look alike by chance."""
LONGEST = 60
"""Most lines of a sample: a sensor_msgs/Imu as ROS 2 prints it has 49."""
_RARE = 0.75
"""Part of the lines of the most frequent sensor below which another one comes less often. With one byte of
1,000 damaged, one line in 20 is damaged."""
AXES = 3
"""Fewest columns of a line, those of a vector; a counter beside fewer others is taken for time."""

_AXIS = re.compile(r"(?i)^([xyz])(?:\d|_val)?$")
_LAST_AXIS = re.compile(r"(?i)[\s_.-]*(?<![a-z])([xyz])(?:\d|_val)?$")
_ENDS = re.compile(r"[,;|\]}\t]+")
_QUOTES = re.compile(r"<[A-Z]\w*>|[\"'{\[:=]+|->")
_BRACKETS = re.compile(r"\[\s*([^\d\[\]\s]{1,12})\s*\]")
_OF_AXIS = re.compile(r"\[\s*([xyzXYZ])\s*\]")
_FIRST_WORDS = re.compile(r"\s*(\S+(?: C)?)(.*)", re.DOTALL)
_SPELLED = {"radians/s": "rad/s", "utesla": "µT", "ms/2": "m/s²", "o/s": "°/s"}
"""Units as libraries of sensors print them."""
_ALIASES = {"accl": "accel", "rotation": "gyro", "rot": "gyro"}
"""Names of the same libraries."""
_IN_UNIT = re.compile(r"(?i)(.+?)(?: in |\s*\()([^\s()]+)\)?[\s(]*$")
"""A name with its unit in words: ``Rotation in deg/sec``, ``Gyro(dps) (``."""
_FILLED = re.compile(r"(?i)(?<=[a-z])[ _](?:values?|readings?|data|raw)$")
"""Words behind a name that say nothing: ``Ax value``."""
_PAIRS = re.compile(r"\S+=\S+\s+(?=\S+=$)")
"""Pairs of words before a name and its sign, as of logfmt: ``level=info ax=``."""
_STAMPED = re.compile(r"\s*>[^:]*:")
"""What stands before the two numbers of a line of Teleplot, ``>name:milliseconds:value``."""
_DEPTH = {**dict.fromkeys("([{", 1), **dict.fromkeys(")]}", -1)}
"""By how much a bracket is deeper."""
_BLANKS = re.compile(r"\s+")
_RULE = re.compile(r"[^\w{}()\[\]]*")
_FIRST_ONES = ("time", "seconds", "force", "rate")
"""What is in the line that begins a sample where nothing else shows it."""


class LabelledSamples(NamedTuple):
    """The lines of a sample, and the numbers in them.

    Attributes
    ----------
    texts : tuple of tuples of str
        As of `lab.data.protocols.column_map.ColumnMap`.
    headings, others : list of str
        For each cell, a heading as of a csv file, and another if that one names nothing: the axis and the
        unit, or the name below the title of the lines.
    rows : (n, k) array
        The numbers.
    clocks : tuple of bool
        Which cells are times of day.
    is_named : bool
        Whether most of the cells have a name of their own: what these do not say is not guessed by numbers.
    """

    texts: tuple[tuple[str, ...], ...]
    headings: list[str]
    others: list[str]
    rows: FloatArray
    clocks: tuple[bool, ...]
    is_named: bool


def labelled_samples(lines: Sequence[str]) -> Iterator[LabelledSamples]:
    """Yield what may be the samples of lines, from those of the fewest lines on.

    Parameters
    ----------
    lines
        Whole lines; an empty one stands for any number of empty lines.
    """
    if (often := _without_rare_vectors(lines)) is not lines:
        yield from labelled_samples(often)
    found: list[Cells] = []
    begins: list[int] = []  # whether a line follows an empty one, 1, or a rule, 2
    begin = 0
    for line in lines:
        cells = cells_in(line)
        if line.strip():
            found.append(_squeeze_blanks(cells))
            begins.append(begin)
        begin = (1 + bool(line.strip())) * (not cells.kinds and _RULE.fullmatch(line) is not None)
    shapes: dict[tuple[tuple[str, ...], str], int] = {}
    ids = np.array([shapes.setdefault((one.texts, one.kinds), len(shapes)) for one in found], dtype=np.int64)
    seen: list[tuple[int, int, int]] = []
    for period in range(1, min(LONGEST, len(ids) // PERIODS) + 1):
        runs = _runs(ids[period:] == ids[:-period], (PERIODS - 1) * period)
        if not runs:
            continue
        first, last = runs[-1]
        # Twice a period is none of its own.
        if any(not period % one and a <= first and last + period <= b + one for one, a, b in seen):
            continue
        seen += [(period, a, b) for a, b in runs]
        at = _find_begin(found, begins, ids, first, period)
        block = found[at : at + period]
        texts = tuple(one.texts for one in block)
        count = sum(len(one.kinds) for one in block)
        if not 1 <= count <= MAX_COLUMNS or any("\\n" in text for line in texts for text in line):
            continue
        rows = [
            [value for one in found[place : place + period] for value in one.values]
            for place in range(len(ids) - period + 1)
            if (ids[place : place + period] == ids[at : at + period]).all()
        ]
        values = np.array(rows).reshape(-1, count)
        rising = [bool((np.diff(one) > 0).all()) for one in values.T]
        headings, others = _headings(block, rising)
        clocks = tuple(kind == "c" for one in block for kind in one.kinds)
        labels = [_name(_cut_unit(text, k)[1]) for one in block for k, text in enumerate(one.texts[:-1])]
        is_named = sum(map(bool, labels)) > count / 2
        yield LabelledSamples(texts, headings, others, values, clocks, is_named)


def _without_rare_vectors(lines: Sequence[str]) -> Sequence[str]:
    """Return lines without those of a sensor that comes less often than others; the same if there is none.

    Such are lines with words before three or more numbers, as of a magnetometer at half the rate.
    """
    shapes = []
    for line in lines:
        cells = _squeeze_blanks(cells_in(line))
        is_vector = len(cells.kinds) >= AXES and any(_name(text) for text in cells.texts[:-1])
        shapes.append((cells.texts, cells.kinds) if is_vector else None)
    counts = Counter(shape for shape in shapes if shape is not None)
    least = _RARE * max(counts.values(), default=0) - 1  # the first and the last sample may be cut
    if all(count >= least for count in counts.values()):
        return lines
    return [
        line for line, shape in zip(lines, shapes, strict=True) if shape is None or counts[shape] >= least
    ]


def _squeeze_blanks(line: Cells) -> Cells:
    """Return a line whose texts have one blank in place of several, and none at its ends."""
    texts = [_BLANKS.sub(lambda blanks: "\t" if "\t" in blanks[0] else " ", text) for text in line.texts]
    texts[0], texts[-1] = texts[0].lstrip(), texts[-1].rstrip()
    return line._replace(texts=tuple(texts))


def _runs(same: NDArray[np.bool_], least: int) -> list[tuple[int, int]]:
    """Return where the runs of lines that repeat long enough begin and end."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], same.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= least]


def _find_begin(
    found: Sequence[Cells], begins: Sequence[int], ids: NDArray[np.int64], first: int, period: int
) -> int:
    """Return the line with which a sample begins.

    That is the line after a rule, or else after an empty one, if there are such, or after what a device says
    when it starts. Of several, and of all without one, it is that of the number of a device, of the time, of
    the accelerometers, or of the gyros, in this order.
    """
    places = range(first, first + period)
    strongest = max(begins[at + period] for at in places)
    marked = [at for at in places if strongest and begins[at + period] == strongest]
    depth = np.cumsum([sum(_DEPTH.get(sign, 0) for sign in "".join(found[at].texts)) for at in places])
    if not marked and depth[-1] == 0 and depth.any():  # where all brackets are closed
        marked = [at for at, before in zip(places, np.roll(depth, 1), strict=True) if before == depth.min()]
    # The first line of all may be cut, and looks like no other one.
    if not marked and first > 1 and not np.isin(ids[1:first], ids[first : first + period]).any():
        return first

    def rank(at: int) -> int:
        if "c" in found[at].kinds:
            return 0
        headings = _headings([found[at]])[0]
        if len(headings) == 1 and names_a_device(headings[0]):
            return -1
        # What stays as it is is no time, such as the t of a temperature.
        steps = (
            after != before for before, after in zip(found[at].values, found[at + period].values, strict=True)
        )
        moving = [heading for heading, moves in zip(headings, steps, strict=True) if moves]
        named = [heading_of(heading) for heading in moving or [f"{_name(found[at].texts[0])} x"]]
        there = {one.quantity for one in named if one is not None}
        return next((k for k, name in enumerate(_FIRST_ONES) if name in there), len(_FIRST_ONES))

    return min(marked or places, key=lambda at: (rank(at), at))


def _headings(block: Sequence[Cells], grow: Sequence[bool] = ()) -> tuple[list[str], list[str]]:
    """Return for each cell of a sample a heading as of a csv file, and another one.

    Parameters
    ----------
    block
        The lines of the sample.
    grow
        Which of its cells increase from sample to sample.
    """
    names: list[tuple[str, str]] = []  # the name and the axis
    groups: list[int] = []  # numbers of one name have one unit
    units: dict[int, str] = {}
    section = title = ""
    titles: list[str] = []  # the last line without a number
    count = 0
    for line in block:
        group = max(groups, default=-1) + 1
        if not line.kinds:
            section = title = _name(line.texts[0]) or section
            count = 0
            continue
        labels = _labels(line)
        # A time stands between the name and three numbers.
        named_alone = len(line.kinds) == 4 and not any(label for _, label in labels[1:])
        if named_alone and labels[0][1] and any(grow[len(names) : len(names) + 1]):
            labels[:2] = [("", "time"), ("", labels[0][1])]
        for at, (unit, label) in enumerate(labels):
            if at and not units.get(groups[-1]):
                units[groups[-1]] = unit
            if at == len(line.kinds):
                continue
            if found := _AXIS.match(label):
                names.append((section, found[1].lower()))
            elif found := _LAST_AXIS.search(label):
                group, count = max(groups, default=-1) + 1, 0
                section, units[group] = _split_unit_words(label[: found.start()])
                names.append((section, found[1].lower()))
            elif label:
                group, count = max(groups, default=-1) + 1, 1
                section, units[group] = _split_unit_words(label)
                names.append((section, ""))
            else:
                group += not section and count and count % AXES == 0  # numbers without a name come in threes
                names.append((section, "xyz"[count : count + 1] if section else "xyz"[count % AXES]))
                count += 1
            groups.append(group)
            titles.append(title)
    # Three numbers behind one name are its axes; the first has the name itself.
    for place, (name, axis) in enumerate(names):
        if not axis and groups[place : place + 3] == groups[place : place + 1] * 3:
            names[place] = name, "x"
    in_units = [f"({units[group]})" if units.get(group) else "" for group in groups]
    headings = [
        " ".join(filter(None, (_known_as(name), axis, unit)))
        for (name, axis), unit in zip(names, in_units, strict=True)
    ]
    others = [
        (f"{axis} {unit}" if unit else "") if axis else f"{title} {name}"
        for (name, axis), unit, title in zip(names, in_units, titles, strict=True)
    ]
    return headings, others


def _known_as(name: str) -> str:
    """Return a name whose last word is that which other files have for it."""
    before, _, word = name.rpartition(" ")
    return f"{before} {_ALIASES[word.lower()]}".strip() if word.lower() in _ALIASES else name


def _labels(line: Cells) -> list[tuple[str, str]]:
    """Return for each text of a line the unit of the number before it, and the name of that behind it."""
    cut = [_cut_unit(text, at) for at, text in enumerate(line.texts)]
    found = [(unit, _name(_PAIRS.sub("", label))) for unit, label in cut]
    if line.texts[1:2] == (":",) and _STAMPED.fullmatch(line.texts[0]):
        found[:2] = [("", "time"), ("", found[0][1])]
    return found


def _split_unit_words(name: str) -> tuple[str, str]:
    """Return a name without its unit in words, and the unit; empty without one."""
    found = _IN_UNIT.match(name)
    unit = _unit(found[2]) if found else ""
    return (found[1], unit) if found and unit else (name, "")


def _cut_unit(text: str, place: int) -> tuple[str, str]:
    """Return the unit of the number before a text, and the name of the number behind it."""
    text = _BRACKETS.sub(r"(\1)", _OF_AXIS.sub(r"_\1", text))
    parts = _ENDS.split(text)
    # What ends with a colon is a name, and none of the units of the number before: ") imu: Rotation:".
    is_name = not place or parts[0].rstrip().endswith(":")
    names = [part for part in (parts if is_name else parts[1:]) if part.strip()]
    # "Accl:", a tabulator, "x=": the axis stands behind the name.
    if place and len(parts) > 2 and not parts[0].strip() and not parts[-1].strip() and len(names) == 1:
        return (unit, "") if (unit := _unit(names[0])) else ("", names[0])  # a cell of its own
    last = ""
    if names and parts[-1].strip():
        last = " ".join(names[-2:] if _AXIS.match(_name(names[-1])) else names[-1:])
    if not place:
        return "", last or text
    if len(parts) > 1:
        return _unit(parts[0]), last
    found = _FIRST_WORDS.match(text)
    unit = _unit(found[1]) if found else ""
    return (unit, found[2]) if found and unit else ("", text)


@lru_cache(maxsize=1024)
def _unit(text: str) -> str:
    """Return the unit that a text is; empty if it is none."""
    text = text.strip(" \t\r\n§").rstrip(".")
    text = _SPELLED.get(text.lower(), text)
    if any(text in units for units in UNITS.values()):
        return text
    return next((unit for kind in UNITS if text and (unit := unit_of(kind, text))), "")


def _name(text: str) -> str:
    """Return the last name in a text, without signs and quotes."""
    words = [word for part in _QUOTES.split(text.replace("'s", "s")) for word in part.split()]
    if "-" in words[1:-1]:  # "INFO - ax", but not "Gyro - x"
        last = len(words) - words[::-1].index("-")
        words = words if _AXIS.match(words[last]) else words[last:]
    return _FILLED.sub("", " ".join(words).strip(" .,;-|/#$>*"))
