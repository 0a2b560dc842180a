"""Allan figures: what the settings promise, against the deviation of what they simulate."""

from __future__ import annotations

import allantools
import numpy as np
import pytest

from lab.analysis import rest
from lab.sensors.suite import SensorSuite
from lab.views.allan import AllanFigures, expected_deviation


@pytest.mark.parametrize("step", [0.0, 0.05, 0.1])
def test_the_promise_holds_with_quantised_samples(step: float) -> None:
    """White noise of 0.05 °/s in a sample of a second, rounded to steps up to twice that."""
    suite = SensorSuite(**{"gyro.noise_density": 0.05, "gyro.bias_sigma": 0.0, "gyro.quantisation": step})
    record = rest.simulate(suite, seed=3)["gyro"]
    assert record.dt == 1.0
    tau = np.array([1.0, 2.0, 4.0, 8.0])
    found = [allantools.oadev(axis, rate=1.0, data_type="freq", taus=tau)[1] for axis in record.rates.T]
    mean = np.sqrt(np.mean(np.square(found), axis=0))
    assert np.allclose(mean, expected_deviation(suite, "gyro", tau)[:, 0], rtol=0.02)


def test_figures_take_a_record_and_forget_it() -> None:
    from lab.analysis import allan

    suite = SensorSuite()
    figures = AllanFigures()
    deviations = {
        triad: allan.deviation(record.rates, record.dt) for triad, record in rest.simulate(suite).items()
    }
    figures.show(suite, deviations)
    source = figures.figures[0].renderers[0].data_source
    assert len(source.data["at"]) == len(source.data["x"]) > 10
    figures.clear()
    assert len(source.data["x"]) == 0
