"""Memory of a flight of four hours at 200 Hz: a run with its verdict, and a page with all its tabs."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from tests.benchmarks.long_flight import CASES, HOURS, RESET

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(4 * 3600)]
MOST = 1.5e9
"""Bar of the laboratory [bytes]."""


@pytest.mark.skipif(not RESET.exists(), reason="this system does not report the peak memory of a step")
@pytest.mark.parametrize("case", CASES)
def test_a_long_flight_stays_below_the_bar(case: str) -> None:
    answer = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.long_flight", case],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    steps = [json.loads(line) for line in answer.stdout.splitlines() if line.startswith("{")]
    print(f"\n{HOURS:g} h, {case}:")
    for step in steps:
        print(f"  {step['step']:<30} {step['peak'] / 1e9:.2f} GB, {step['seconds']:.0f} s")
    assert max(step["peak"] for step in steps) <= MOST
