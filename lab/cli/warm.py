"""``ins-lab warm``: the filter is compiled for every combination of settings before somebody needs it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Annotated

import typer

from lab.cli.app import working

EXAMPLES = """\b
Examples:
  ins-lab warm
The first run with a model of the filter, a number of states, the smoother or another rate of
the covariance compiles the filter for it, which takes some seconds. This command does it for
all combinations, and takes minutes the first time. `ins-lab serve` does the same in the
background."""

AT_ONCE = 6
"""Combinations that one process compiles: the compiler keeps some 45 MB of each (measured on Linux)."""


def warm(
    idle: Annotated[
        bool, typer.Option("--idle", help="Work only while the computer has nothing else to do.")
    ] = False,
) -> None:
    """Compile the filter ahead for every combination of settings, so that nobody waits for it."""
    from lab.base.compiling.compiled_cache import LOWEST_PRIORITY  # noqa: PLC0415 - help does not need the compiler

    if idle and hasattr(os, "nice"):
        os.nice(LOWEST_PRIORITY)
    from multiprocessing import get_context  # noqa: PLC0415 - help does not need it

    from lab.experiment import variants  # noqa: PLC0415 - takes a second

    found, usable = variants.variants(), 0
    with (
        working("warm") as progress,
        get_context("spawn").Pool(1, maxtasksperchild=AT_ONCE) as fresh,
    ):
        progress(_describe(found[0]), 0.0)
        for done, accepted in enumerate(fresh.imap(variants.compile_variant, found), 1):
            usable += accepted
            progress(
                _describe(found[done]) if done < len(found) else "error budget, many seeds", done / len(found)
            )
        fresh.apply(variants.compile_verdict)
        fresh.apply(variants.compile_budget)
        fresh.apply(variants.compile_lanes)
    print(f"The filter is compiled for {usable} of {len(found)} combinations; the others are not accepted.")


def _describe(assignments: Mapping[str, object]) -> str:
    """Return settings in words, such as ``model psi, states 21, mechanization north-slaved``."""
    return ", ".join(f"{name.rpartition('.')[2]} {value}" for name, value in assignments.items())
