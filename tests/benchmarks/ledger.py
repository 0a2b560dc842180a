"""Ledger: what the lab claims of itself in docs/measurements.toml, and the commands that repeat it.

``python -m tests.benchmarks.ledger [words in claims ...]`` runs the commands of the rows, all of them without
words, and writes the date, the seconds of a processor, and the figure of a command whose output has it.
``make ledger`` runs all. ``python -m tests.benchmarks.ledger --share`` runs nothing, and prints how many are
validated, and which are not.
"""

from __future__ import annotations

import os
import re
import resource
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from lab.base.parameters.toml_file import read_toml

ROOT = Path(__file__).parents[2]
LEDGER = ROOT / "docs" / "measurements.toml"
SHORT = 20.0
"""Seconds of a processor below which a row is run with the proofs."""
LONGEST = 4 * 3600.0
"""Longest run of a row [s]."""
_HERE = {"pytest": "pytest", "python": "", "ins-lab": "dashboards"}
_TEXTS = "claim", "figure", "oracle", "command", "reads", "missed"
_NUMBERS = "low", "high", "seconds"


class Row(NamedTuple):
    """A claim: what it is, its figure, what it is compared with, and how it is repeated.

    Attributes
    ----------
    claim, figure : str
        What was measured, and what came out.
    oracle : str
        What it is compared with, not written here; empty for the figure of a model.
    command : str
        Repeats it; empty if nothing does.
    reads : str
        What stands before the number in the output; empty if the command judges by itself.
    low, high : float
        What the number may be.
    seconds : float
        Time of a processor that the last run took; 0 before the first.
    missed : str
        The mark that the figure misses.
    date : str
        Day of the last run.
    """

    claim: str
    figure: str
    oracle: str = ""
    command: str = ""
    reads: str = ""
    low: float = 0.0
    high: float = 0.0
    seconds: float = 0.0
    missed: str = ""
    date: str = ""

    @property
    def is_validated(self) -> bool:
        """Whether the figure is compared with what was not written here, by a command."""
        return bool(self.oracle and self.command)


class Outcome(NamedTuple):
    """What a command did: whether its row holds, the number read, the time taken [s], its last lines."""

    holds: bool
    number: float | None
    seconds: float
    words: str


def rows(path: Path = LEDGER) -> list[Row]:
    """Return the rows of a ledger.

    Raises
    ------
    ValueError
        If a row has a wrong key or value, or no claim or figure.
    """
    found = []
    for number, row in enumerate(read_toml(path)["row"], 1):
        unknown = set(row) - set(Row._fields)
        wrong = {key for key in _TEXTS if not isinstance(row.get(key, ""), str)}
        wrong |= {key for key in _NUMBERS if not isinstance(row.get(key, 0), int | float)}
        if unknown | wrong or not row.get("claim") or not row.get("figure"):
            raise ValueError(
                f"{path.name}, row {number}: {sorted(unknown | wrong) or 'no claim or no figure'}"
            )
        found.append(Row(**{**row, "date": str(row.get("date", ""))}))
    return found


def run(row: Row) -> Outcome:
    """Run the command of a row in the root of the clone."""
    program, *words = shlex.split(row.command)
    module = _HERE.get(program)
    start = [program] if module is None else [sys.executable, *(["-m", module] if module else [])]
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    before = _used()
    done = subprocess.run(
        [*start, *words], cwd=ROOT, env={**os.environ, "PYTHONPATH": paths}, timeout=LONGEST,
        capture_output=True, text=True, encoding="utf-8", check=False,
    )  # fmt: skip
    seconds = _used() - before
    last = "\n".join((done.stdout + done.stderr).splitlines()[-12:])
    if done.returncode:
        return Outcome(False, None, seconds, last)
    number = read(row, done.stdout)
    holds = not row.reads or (number is not None and row.low <= number <= row.high)
    return Outcome(holds, number, seconds, last)


def read(row: Row, output: str) -> float | None:
    """Return the number behind the words of a row in the output of its command; None without."""
    found = (
        re.search(re.escape(row.reads) + r"\s*([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)", output) if row.reads else None
    )
    return float(found[1]) if found else None


def written(text: str, row: Row, outcome: Outcome, day: str) -> str:
    """Return the text of a ledger with the outcome of a row: date, seconds, and the figure that was read."""
    begin = text.index(f"claim = {_quoted(row.claim)}")
    end = text.find("\n[[row]]", begin)
    part = text[begin:] if end < 0 else text[begin:end]
    new = re.sub(r"(?m)^date = .*$", f"date = {day}", part)
    new = re.sub(r"(?m)^seconds = .*\n", "", new).rstrip("\n") + f"\nseconds = {outcome.seconds:.1f}\n"
    if outcome.number is not None:
        new = re.sub(r"(?m)^figure = .*$", f"figure = {_quoted(f'{outcome.number:g}')}", new)
    return text.replace(part, new)


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _used() -> float:
    """Return the time of a processor of all processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def share() -> None:
    """Print how many rows are validated, and the claims of the others."""
    known = rows()
    others = [row for row in known if not row.is_validated]
    for row in others:
        print(f"{'modelled' if row.command else 'no command'}   {row.claim}")
    validated = len(known) - len(others)
    missed = sum(bool(row.missed) for row in known)
    part = f"{validated} of {len(known)} claims validated: {100 * validated / len(known):.0f} %"
    print(f"{part}; {missed} miss a mark")


def main(words: list[str]) -> int:
    """Run the rows whose claim or command has all words; return the number that does not hold."""
    if words == ["--share"]:
        share()
        return 0
    chosen = [one for one in rows() if all(word in f"{one.claim} {one.command}" for word in words)]
    failed, done = 0, dict[str, Outcome]()
    for row in chosen:
        if not row.command:
            print(f"no command   {row.claim}", flush=True)
            continue
        outcome = done[row.command] if row.command in done else run(row)
        done[row.command] = outcome
        told = "holds" if outcome.holds else "DOES NOT HOLD"
        number = "" if outcome.number is None else f" {outcome.number:g}"
        print(f"{told}{number}   {row.claim}   ({outcome.seconds:.0f} s)", flush=True)
        if outcome.holds:
            day = datetime.now(UTC).date().isoformat()
            LEDGER.write_text(written(LEDGER.read_text("utf-8"), row, outcome, day), "utf-8")
        else:
            failed += 1
            print(outcome.words, flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1:]), 1))
