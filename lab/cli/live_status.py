"""Live status: what `ins-lab live` prints of a source: its state, what came, and what was lost."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from lab.base.parameters.counted import count_noun
from lab.cli.app import CommandError

if TYPE_CHECKING:
    from lab.data.streams.source import Source
    from lab.data.streams.source_status import Status


def source_line(source: Source, status: Status, seconds: float) -> str:
    """Return the state of a source as a line of `ins-lab live watch`."""
    import numpy as np  # noqa: PLC0415 - help does not need it

    last = source.last(0.1).imu[-1:]
    cells = [" " * 27, " " * 27]
    if len(last):
        rate, force = np.degrees(last["rate"][0]), last["force"][0]
        cells = [
            f"{rate[0]:9.3f}{rate[1]:9.3f}{rate[2]:9.3f}",
            f"{force[0]:9.3f}{force[1]:9.3f}{force[2]:9.3f}",
        ]
    return f"{seconds:8.1f}  {status.rate:9.2f}  {status.fixes:5d}  {cells[0]}  {cells[1]}  {status.sentence}"


def source_row(source: Source, status: Status) -> dict[str, Any]:
    """Return the state of a source as JSON holds it, by names."""
    last = source.last(0.1).imu[-1:]
    state: dict[str, Any] = {
        name: getattr(status, name)
        for name in (
            "state", "sentence", "protocol", "timing", "samples", "fixes", "rate", "fix_rate", "jitter",
            "latency", "drift", "drift_sigma", "silence", "interruptions", "question",
        )
    }  # fmt: skip
    state["axes"] = str(status.axes)
    state["statistics"], state["loss"] = vars(status.statistics), vars(status.loss)
    if len(last):
        state["time"] = float(last["time"][0])
        state["rate_rad_s"], state["force_m_s2"] = last["rate"][0], last["force"][0]
    return state


def check_came(source: str, status: Status) -> None:
    """Refuse a source that sent nothing, or nothing that could be read."""
    if status.samples + status.fixes:
        return
    seen = status.statistics.bytes
    what = f"only {count_noun(seen, 'byte')}" if seen else "and no byte"
    why = "" if status.evidence in status.sentence else f"{status.evidence} "
    from lab.data.protocols.column_guess import advice_on_lines  # noqa: PLC0415 - help does not need it

    advice = advice_on_lines(status.last_lines)
    said = f"{source}: no sample came, {what}. {why}{status.sentence}"
    raise CommandError(f"{said}\n{advice}" if advice else said)


def print_conclusion(status: Status) -> None:
    """Say on standard error what came, and what was lost."""
    from lab.data.streams.imu_clock import BY_NUMBERS  # noqa: PLC0415 - help does not need it
    from lab.data.streams.source_status import STALE  # noqa: PLC0415

    for sentence in (status.evidence, f"Timed {status.timing}." if status.timing else ""):
        if sentence:
            print(f"ins-lab: {sentence}", file=sys.stderr)
    seen, loss = status.statistics, status.loss
    lost = {
        f"{count_noun(status.interruptions, 'interruption')} of the connection": status.interruptions,
        f"silent for the last {status.silence:.0f} s": status.state == STALE,
        f"{count_noun(seen.skipped, 'byte')} skipped": seen.skipped,
        f"{count_noun(seen.failed, 'check')} failed": seen.failed,
        f"{count_noun(seen.refused, 'sample')} refused": seen.refused,
        f"{loss.missing} missing": loss.missing,
        f"{loss.repeated} repeated": loss.repeated,
        f"{loss.backwards} backwards": loss.backwards,
        f"{count_noun(loss.jumps, 'change')} of the device's clock": loss.jumps,
    }
    told = ", ".join(text for text, count in lost.items() if count)
    nothing = "nothing was lost"
    if BY_NUMBERS in status.timing:
        nothing = "losses do not show, as nothing numbers or times its samples"
    elif status.samples and status.rate > 0:  # every second one may be lost all the time
        nothing += f", if it sends {status.rate:.4g} samples a second"
    print(f"ins-lab: {count_arrivals(status)}; {told or nothing}.", file=sys.stderr)


def count_arrivals(status: Status) -> str:
    """Return how many samples and fixes came, in words."""
    return f"{count_noun(status.samples, 'sample')}, {count_noun(status.fixes, 'fix')}"
