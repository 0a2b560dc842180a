"""The ledger of measurements: its rows can be run, and the short ones hold."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from tests.benchmarks.ledger import ROOT, SHORT, Row, read, rows, run, written

ROWS = rows()


def test_most_claims_are_validated() -> None:
    assert sum(row.is_validated for row in ROWS) >= 0.7 * len(ROWS)


def test_no_claim_stands_twice() -> None:
    assert len({row.claim for row in ROWS}) == len(ROWS)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.claim)
def test_the_command_of_a_row_is_there(row: Row) -> None:
    program, *words = shlex.split(row.command) if row.command else ("",)
    assert program in ("", "pytest", "python", "make", "ins-lab")
    if program == "pytest":
        assert all((ROOT / word).is_file() for word in words if not word.startswith("-"))
    if program == "python":
        assert (ROOT / f"{words[1].replace('.', '/')}.py").is_file()
    assert row.low <= row.high
    if row.reads:
        figure = read(row, f"{row.reads} {row.figure}")
        assert figure is not None
        assert row.low <= figure <= row.high
        if not row.missed:  # the mark of a right filter: what the claim names as expected
            expected = float(row.claim.split(" expected")[0].split()[-1])
            assert figure == pytest.approx(expected, rel=0.15)


@pytest.mark.proof
@pytest.mark.parametrize(
    "row",
    [row for row in ROWS if row.reads and 0 < row.seconds < SHORT],
    ids=lambda row: row.claim,
)
def test_a_short_row_holds(row: Row, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows of tests are run as tests."""
    if "../shared" in row.command and not (ROOT.parent / "shared").is_dir():
        pytest.skip("needs the folder ../shared with real logs")
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path))
    outcome = run(row)
    assert outcome.holds, (outcome.number, outcome.words)


def test_a_run_is_written_into_its_row_alone(tmp_path: Path) -> None:
    row = '[[row]]\nclaim = {}\nfigure = "1"\ndate = 2026-01-01\n'
    text = row.format('"a \\"b\\""') + "\n" + row.format('"c"')
    file = tmp_path / "measurements.toml"
    file.write_text(text, "utf-8")
    first = rows(file)[0]._replace(command="python -c 'print(\"NEES: 2.5 / 15\")'", reads="NEES: ", high=3.0)
    outcome = run(first)
    assert outcome.holds
    assert not run(first._replace(high=2.0)).holds
    assert not run(first._replace(command="python -c 'raise SystemExit(3)'")).holds
    file.write_text(written(text, first, outcome, "2026-02-03"), "utf-8")
    after = rows(file)
    assert (after[0].figure, after[0].date) == ("2.5", "2026-02-03")
    assert "seconds = " in file.read_text("utf-8")
    assert after[1] == rows(file)[1]
    assert after[1].date == "2026-01-01"


@pytest.mark.parametrize(
    "bad", ['claim = "a"', 'claim = "a"\nfigure = 3', 'claim = "a"\nfigure = "1"\nwho = "x"']
)
def test_a_wrong_row_is_refused_by_its_number(tmp_path: Path, bad: str) -> None:
    file = tmp_path / "measurements.toml"
    file.write_text(f"[[row]]\n{bad}\n", "utf-8")
    with pytest.raises(ValueError, match="row 1"):
        rows(file)
