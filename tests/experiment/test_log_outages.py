"""Outages of a log: fixes are withheld as published comparisons do, and the filter never sees them."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_logs import tables, write

from lab import Experiment
from lab.base.progress import StoppedError
from lab.motion.frames.displacement import displacement

SECONDS = 20.0


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Return an experiment on a log of three minutes."""
    folder = write(tmp_path_factory.mktemp("logs") / "drive", tables(10, 200))
    found = Experiment(mission=str(folder))
    return found.update({"sensors": {"gyro": {"bias_sigma": 0.3}, "gps": {"velocity_variance": 0.01}}})


@pytest.fixture(scope="module")
def table(drive):
    return drive.outage(SECONDS, wish=10.0)


def test_the_outages_cover_the_log_and_do_not_overlap(drive, table):
    errors = table.rows[0].errors
    begins = np.sort(errors.begins)
    end = float(drive.run().time[-1])
    assert set(errors.seeds.tolist()) == {0, 1, 2}
    assert np.allclose(np.diff(begins), SECONDS, atol=0.5)
    assert 29 < begins[0] <= 30.5
    assert end - SECONDS < begins[-1] + SECONDS <= end
    for turn in range(3):
        assert np.allclose(np.diff(np.sort(errors.begins[errors.seeds == turn])), 3 * SECONDS, atol=0.5)


def test_the_error_is_that_of_a_run_without_these_fixes(drive, table):
    """All outages of a turn as settings: the filter gets no fix there, and is compared with the last."""
    errors = table.rows[0].errors
    epoch = drive.run().epoch
    for turn in range(3):
        begins = errors.begins[errors.seeds == turn]
        alone = drive.copy()
        alone.set("sensors.gps.outages", [(b + epoch + 0.1, b + epoch + SECONDS + 0.1) for b in begins])
        result = alone.run()
        fixes = result.recorded.log.gnss
        for begin, horizontal, vertical in zip(
            begins,
            *(part[errors.seeds == turn, -1] for part in (errors.horizontal, errors.vertical)),
            strict=True,
        ):
            last = int(np.flatnonzero(fixes.time < begin + SECONDS + 0.1)[-1])
            sample = int(np.searchsorted(result.time, fixes.time[last] - 1e-6))
            found = displacement(
                fixes.position[last : last + 1], result.solution_arrays.position[sample : sample + 1]
            )[0]
            assert (horizontal, vertical) == pytest.approx(
                (np.hypot(*found[:2]), abs(found[2])), rel=1e-3, abs=1e-3
            )


def test_it_says_what_it_can_know(table):
    assert table.is_log
    assert table.fix_sigma == pytest.approx(np.hypot(0.5, 0.5), rel=0.01)
    assert "0.707 m (horizontal)" in table.remarks[0]
    assert "perfect filter would be is unknown for a log" in table.tuning
    assert "factor" not in table.tuning
    assert table.rows[0].perfect is None
    assert table.to_dict()["fix_sigma_m"] == pytest.approx(0.707, abs=0.01)


def test_the_drift_begins_with_the_first_withheld_fix(table):
    errors = table.rows[0].errors
    assert np.isfinite(errors.horizontal[:, 1:]).all()
    early, late = (np.nanmedian(errors.horizontal[:, at]) for at in (1, -1))
    assert early < late
    assert (np.diff(errors.sigma[:, 1:], axis=1) > 0).all()


def test_each_card_is_a_filter_of_the_log(drive):
    both = drive.outage(SECONDS, ["STIM300", "BMI088"])
    good, poor = both.rows
    assert good.runs == poor.runs
    assert good.believed < poor.believed


def test_a_gap_of_the_log_is_not_an_outage(tmp_path, drive):
    log = tables(10, 200)
    stamps = log.gnss[:, 0] - log.gnss[0, 0]
    folder = write(tmp_path / "gap", log._replace(gnss=log.gnss[(stamps < 80) | (stamps > 95)]))
    gap = drive.copy()
    gap.set("mission", str(folder))
    errors = gap.outage(SECONDS).rows[0].errors
    assert errors.begins.size == 6
    assert np.isfinite(errors.horizontal[:, -1]).all()


@pytest.mark.parametrize(
    ("seconds", "words"), [(500, "no outage of 500 s fits into the log"), (0.5, "1 or more")]
)
def test_an_outage_that_does_not_fit_is_refused(drive, seconds, words):
    with pytest.raises(ValueError, match=words):
        drive.outage(seconds)


def test_cancelled_rows_are_left_empty(drive):
    told: list[float] = []
    found = drive.outage(
        SECONDS,
        ["STIM300", "BMI088"],
        progress=lambda _words, fraction: told.append(fraction),
        cancelled=lambda: bool(told),
    )
    assert [row.runs > 0 for row in found.rows] == [True, False]
    with pytest.raises(StoppedError):
        drive.outage(SECONDS, cancelled=lambda: True)
