"""``ins-lab judge``: a filter that is not ours, judged by what its log says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli.app import argument, print_json, working
from lab.cli.options import AsJson
from lab.cli.terminal import paragraphs, table

if TYPE_CHECKING:
    from lab.analysis.verdicts.foreign_verdict import ForeignVerdict

EXAMPLES = """\b
Examples:
  ins-lab judge copter.ulg
  ins-lab judge copter.bin --smoother
  ins-lab judge innovations.csv --json
A csv has the headings of innovations.csv, which Result.to_csv writes: time [s], position east [m],
position_sigma east [m], ...; docs/judge.md describes it."""


def judge(
    log: Annotated[
        Path, argument("LOG", "PX4 ULog, ArduPilot DataFlash log, or a csv of innovations and their σ.")
    ],
    smoother: Annotated[
        bool,
        typer.Option(
            "--smoother", help="Compare its positions with our smoothed solution of the same sensors."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Judge the filter of an autopilot's log, or of a csv of innovations."""
    from lab.experiment.judged_log import judge as judged  # noqa: PLC0415 - takes half a second

    with working(str(log)) as progress:
        found = judged(log, smoother=smoother, progress=progress)
    if as_json:
        from lab.run.provenance import describe_origin  # noqa: PLC0415 - help does not need it

        print_json({**describe_origin(), **facts(found)})
    else:
        print(_text(found))


def _text(found: ForeignVerdict) -> str:
    parts = [found.verdict.headline, _table(found)]
    said = [(one.sentence, one.counsel, one.evidence) for one in found.verdict.findings]
    parts += ["\n".join(f"- {sentence} {advice}".rstrip() + f"\n  [{why}]" for sentence, advice, why in said)]
    statements = (*found.comparisons, *found.remarks)
    parts.append("\n".join(f"- {one.sentence}\n  [{one.evidence}]" for one in statements))
    if found.log.events:
        lines = [f"  {one.time:10.1f} s  {one.kind:9} {one.text} [{one.source}]" for one in found.log.events]
        parts.append("\n".join(("What happened:", *lines)))
    parts.append(f"What its own flags say: {found.log.flags}")
    return paragraphs(*parts)


def _table(found: ForeignVerdict) -> str:
    rows = [
        (
            one.innovations.name,
            f"{one.count}",
            _number(one.mean_square),
            " to ".join(map(_number, one.interval)),
            _number(float(one.lagged[0])),
            f"{one.rejected.sum()}",
            _number(one.worst),
        )
        for one in found.measurements
    ]
    header = (
        "measurement",
        "number",
        "mean square",
        "matched",
        "correlation",
        "rejected",
        "test ratio up to",
    )
    return table(header, rows, right={1, 2, 3, 4, 5, 6})


def _number(value: float) -> str:
    return f"{value:.3g}".replace("nan", "–")


def facts(found: ForeignVerdict) -> dict[str, Any]:
    """Return a verdict on a foreign filter as plain data."""
    return {
        "log": found.log.name,
        "filter": found.log.filter,
        "lane": found.log.lane.name,
        "span_s": list(found.log.span),
        "verdict": found.verdict.headline,
        "basis": found.verdict.basis,
        "consistent": found.verdict.consistent,
        "findings": [
            {
                "quantity": one.quantity,
                "direction": one.direction,
                "factor": one.factor,
                "interval": one.interval,
                "sentence": one.sentence,
                "advice": one.advice,
                "evidence": one.evidence,
            }
            for one in found.verdict.findings
        ],
        "measurements": [
            {
                "name": one.innovations.name,
                "unit": one.innovations.unit,
                "axes": list(one.innovations.axes),
                "number": one.count,
                "mean_square": one.mean_square,
                "matched": list(one.interval),
                "independent": one.independent,
                "correlation": one.lagged,
                "bias_sigma": one.bias,
                "rejected": int(one.rejected.sum()),
                "largest_test_ratio": one.worst,
                "source": one.innovations.source,
            }
            for one in found.measurements
        ],
        "remarks": [one._asdict() for one in found.remarks],
        "comparisons": [one._asdict() for one in found.comparisons],
        "events": [one._asdict() for one in found.log.events],
        "flags": found.log.flags,
    }
