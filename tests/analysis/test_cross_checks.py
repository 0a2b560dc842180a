"""What a log tells of its own errors: withheld fixes, and the filter against the smoother."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sensor_logs import tables, write

from lab.analysis.cross_checks import CrossChecks, cross_checks
from lab.analysis.identification.identification import HeldOut
from lab.analysis.identification.renavigation import subject
from lab.analysis.identification.withheld import held_out, outages
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result


def run(folder: Path, **settings: object) -> Result:
    write(folder, tables(60, 200))
    (folder / "ref.csv").unlink()
    experiment = Experiment(mission=str(folder))
    for path, value in settings.items():
        experiment.set(path.replace("__", "."), value)
    return experiment.run()


def checked(result: Result) -> CrossChecks:
    told: list[float] = []
    found = cross_checks(result, lambda _stage, fraction: told.append(fraction))
    assert told == sorted(told)
    assert len(told) > 2
    return found


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(tmp_path_factory.mktemp("log") / "drive", navigator__hold_heading=False)  # as the smoother


@pytest.fixture(scope="module")
def found(log: Result) -> CrossChecks:
    return checked(log)


def test_fixes_are_withheld_at_their_places(log: Result, found: CrossChecks) -> None:
    known = np.isfinite(found.withheld)
    assert found.withheld.shape == log.fixes.time.shape
    since = found.fixes.time - found.fixes.time[0]
    assert 0.3 < known[since > 40].mean() < 0.6, "10 s in 20 s"
    assert not known[since < 25].any(), "the start is no test"
    again = subject(log)
    settled = again.span[0] + 30
    masks = outages(again.stamps, settled, again.span[1])
    judged: HeldOut = held_out(again, log.experiment, masks, np.zeros(again.stamps.size, bool))
    assert np.count_nonzero(known) == judged.fixes
    assert np.sqrt(np.nanmean(found.withheld**2)) < judged.position_error, "without height"


def test_predictions_are_worse_the_longer_a_fix_is_withheld(found: CrossChecks) -> None:
    known = np.flatnonzero(np.isfinite(found.withheld))
    first = known[np.diff(known, prepend=-9) > 1]
    last = known[np.diff(known, append=known[-1] + 9) > 1]
    assert (found.withheld_sigma[last] > found.withheld_sigma[first]).all()


def test_filter_and_smoother_meet_at_the_end(found: CrossChecks) -> None:
    assert found.problem == ""
    assert found.apart[-1] == pytest.approx(0, abs=1e-6)
    assert found.apart_sigma[-1] == pytest.approx(0, abs=1e-3)
    assert found.turned[-1] == pytest.approx(0, abs=1e-6)
    assert np.isfinite(found.apart).all()
    assert np.isfinite(found.turned_sigma).all()
    assert np.mean(found.apart <= 3 * found.apart_sigma + 1e-9) > 0.9


def test_a_smoothed_run_is_compared_with_its_filter(tmp_path: Path, found: CrossChecks) -> None:
    other = checked(run(tmp_path / "drive", navigator__smoother=True, navigator__hold_heading=False))
    np.testing.assert_allclose(other.apart, found.apart, atol=1e-6)
    np.testing.assert_allclose(other.turned_sigma, found.turned_sigma, atol=1e-6)


def test_without_a_smoother_the_withheld_fixes_stay(tmp_path: Path) -> None:
    nonlinear = checked(run(tmp_path / "drive", navigator__model="nonlinear"))
    assert "smoother" in nonlinear.problem
    assert np.isnan(nonlinear.apart).all()
    assert np.isfinite(nonlinear.withheld).any()
