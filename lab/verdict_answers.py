"""Verdict answers: what the command line says of verdicts and of compared models, as tables and as JSON."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from lab.analysis.verdict import Verdict
from lab.comparison import NIS_DEGREES
from lab.terminal import table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lab.comparison import Compared

_TITLES = ("model", "position [m]", "velocity [m/s]", "heading [°]", "NEES", "NIS", "time [ms]", "verdict")


def verdict_text(verdict: Verdict) -> str:
    """Return a verdict as text: the headline, then each finding beyond the first, and what to try."""
    lines = [f"Verdict ({verdict.basis}): {verdict.headline}"]
    for number, finding in enumerate(verdict.findings):
        lines += [f"  {finding.sentence}"] if number else []
        lines += [f"  Try: {finding.advice} ({finding.evidence})"]
    return "\n".join(lines)


def verdict_json(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict ready for JSON."""
    findings = [
        {key: _finite(value) for key, value in asdict(finding).items()} for finding in verdict.findings
    ]
    return {
        "headline": verdict.headline,
        "consistent": verdict.consistent,
        "basis": verdict.basis,
        "findings": findings,
    }


def comparison_table(rows: Sequence[Compared]) -> str:
    """Return compared models as a table: rms errors, mean NEES and NIS beside what they should be, time."""
    cells = [
        (
            row.model,
            *(_shown(value) for value in (row.position, row.velocity, row.heading)),
            f"{_shown(row.nees, '.1f')} / {row.degrees}" if row.degrees else "–",
            f"{_shown(row.nis, '.2f')} / {NIS_DEGREES}" if row.degrees else "–",
            _shown(1000 * row.seconds, ".0f"),
            row.verdict or f"Does not run: {row.refusal}",
        )
        for row in rows
    ]
    return table(_TITLES, cells, right=set(range(1, len(_TITLES) - 1)))


def comparison_json(rows: Sequence[Compared]) -> list[dict[str, Any]]:
    """Return compared models ready for JSON."""
    return [{key: _finite(value) for key, value in asdict(row).items()} for row in rows]


def _shown(value: float, form: str = ".3f") -> str:
    return f"{value:{form}}" if math.isfinite(value) else "–"


def _finite(value: Any) -> Any:
    """Return the value as JSON has it, which knows no NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
