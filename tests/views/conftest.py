"""One result for all tests of the views."""

from __future__ import annotations

import pytest

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result


@pytest.fixture(scope="session")
def result() -> Result:
    """Return the result of the default experiment."""
    return Experiment().run()
