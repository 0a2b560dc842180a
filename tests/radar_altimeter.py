"""Radar altimeter: what is asked of a sensor that was added to the aid table, in a process of its own.

`tests/base/test_aid_table.py` runs it with a copy of the lab that has the sensor, with the name of its error,
a folder, and the only models that are asked, for a short run.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from bokeh.document import Document
from live_batch import assert_equal, navigator, random_pieces, suite
from live_rows import HOST, RATE, driven, feed, reading_rows

import lab
from dashboards.session import Session
from dashboards.settings_panel import SettingsPanel
from dashboards.titled import Card
from lab import Experiment
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.protocols.column_map import ColumnMap
from lab.data.protocols.text_lines import TextLines
from lab.data.streams.live_log import make_log
from lab.navigation.aids import NAMES
from lab.navigation.log_navigation import navigate_log
from lab.navigation.log_readings import drop_sensors_without_readings
from lab.navigation.settings import NavigatorSettings
from lab.views.budget import FAMILIES
from lab.views.quantities import aid_plots

KIND = NAMES.index("height above ground")
GROUP = "sensors.radar_altimeter"
FLOWN = {"trajectory.imu_rate": 10.0, f"{GROUP}.fitted": True}


END = 35
"""Length of the drive [s]: it begins to move at 20 s."""


def fly(**settings: object):
    """Return the result of a short flight with the sensor."""
    return Experiment(mission="los_angeles").update(FLOWN | settings).run()


def check_estimates(error: str, models: Sequence[str]) -> None:
    """Ask that every model estimates the error, one of them as the reference does, with the right NIS."""
    reference = fly(**{"navigator.engine": "filterpy"}).solution_arrays
    for model in models:
        result = fly(**{"navigator.model": model})
        solution = result.solution_arrays
        assert (result.aids.kind == KIND).all()
        assert result.aids.time.size > 50
        if model == "phi":
            np.testing.assert_allclose(solution.position, reference.position, rtol=0, atol=1e-8)
            np.testing.assert_allclose(solution.variance, reference.variance, rtol=1e-6, atol=1e-12)
            np.testing.assert_allclose(solution.aid_innovation, reference.aid_innovation, atol=1e-6)
        nis = solution.aid_innovation**2 / solution.aid_variance
        assert abs(nis.mean() - 1) < 4 * np.sqrt(2 / nis.size)
        states = result.further_states.sel(state=f"radar altimeter {error}")
        off = float((states.estimate - states.truth)[-1] / states.sigma[-1])
        assert abs(off) < 4
        assert float(states.sigma[-1]) < float(states.sigma[0])


def check_analysis(error: str) -> None:
    """Ask that verdict, budget and plots know it."""
    result = fly()
    sources = [str(name) for name in result.budget.source.values]
    wanted = {"bias": ["bias", "noise", "drift"], "scale": ["scale factor", "noise"]}[error]
    assert [name for name in sources if name.startswith("radar")] == [
        f"radar altimeter {one}" for one in wanted
    ]
    assert all(name.partition(" ")[0] in FAMILIES for name in sources)
    (plot,) = aid_plots((KIND,))
    assert (plot.title, plot.unit) == ("Height above ground innovation", "m")
    assert plot.curves[0].read(result).size == result.aids.time.size
    wrong = fly(**{"navigator.aiding_scale": 0.05})
    (found,) = (one for one in wrong.verdict.findings if one.quantity == "R height above ground")
    assert f"Set {GROUP}.noise" in found.advice


def check_settings(error: str) -> None:
    """Ask for its settings in a group of the page."""
    session = Session(Document())
    panel = SettingsPanel(session)
    (card,) = (one for one in panel.view.select(Card) if one.title == "Radar altimeter")
    card.collapsed = False
    always = "fitted", "noise", "bias_sigma" if error == "bias" else "scale_factor_sigma"
    assert {path for path in panel._fields if "radar" in path} == {f"{GROUP}.{term}" for term in always}
    session.close()


def check_log_and_stream(folder: Path) -> None:
    """Ask that a stream uses the readings as the batch does, and that a log keeps them."""
    imu, fixes, trajectory = driven(late=0.2)
    imu, fixes = imu[: int(END * RATE)], fixes[fixes["time"] < HOST + END]
    times = np.arange(0.1, END, 0.25)
    height = suite().radar_altimeter.truth(trajectory, 1, times)
    height += np.random.default_rng(1).normal(0, 0.3, times.size)
    rows = reading_rows("radar_height", times, height, 0.1)
    sensors = suite()
    sensors.set("radar_altimeter.fitted", True)
    live = navigator(sensors=sensors)
    feed(live, imu, fixes, random_pieces(1), rows)
    log = make_log("replay", imu, fixes, vehicle="car", readings=rows)
    run = navigate_log(log, sensors, NavigatorSettings(vehicle="car"), start=live.alignment)
    assert run.solution.states == 16
    assert (run.solution.aid_sample >= 0).sum() > 100
    assert_equal(live, run)
    write_sensor_log(folder / "log", log, title="Drive")
    again = read_sensor_log(folder / "log")
    assert [path.name for path in (folder / "log").glob("radar*")] == ["radar.csv"]
    np.testing.assert_allclose(again.auxiliary.series["radar_altimeter"].value, height, atol=1e-9)
    mine = live.log().auxiliary.series["radar_altimeter"]
    np.testing.assert_array_equal(mine.value, log.auxiliary.series["radar_altimeter"].value)
    _, remarks = drop_sensors_without_readings(suite(), {}, again)
    assert remarks == [
        "The log has readings of a radar altimeter that are not used; sensors.radar_altimeter.fitted = true "
        "uses them."
    ]


def check_text_lines() -> None:
    """Ask that a device that writes text sends it in a column, in the units that a length has."""
    for unit, metres in (("m", 1.0), ("ft", 0.3048), ("cm", 0.01)):
        header = f"time[s],force_x[g],force_y[g],force_z[g],radar_height[{unit}]"
        lines = b"\n".join(b"%.2f,0,0,-1,%d.5" % (0.1 * k, k) for k in range(1, 30)) + b"\n"
        said = TextLines(ColumnMap.of(header))
        for decoder, text in ((said, lines), (TextLines(), f"{header}\n".encode() + lines)):
            found = decoder.feed(text)
            values = found.reading["radar_height"]
            first = 30 - values.size  # without a header, the first line may be cut
            assert first <= 2
            np.testing.assert_allclose(values, metres * (np.arange(first, 30) + 0.5))
            assert np.isnan(found.reading["speed"]).all()


if __name__ == "__main__":
    print(lab.__file__)
    check_text_lines()
    check_settings(sys.argv[1])
    check_estimates(sys.argv[1], sys.argv[3:] or ["phi", "psi", "invariant", "nonlinear"])
    if not sys.argv[3:]:
        check_analysis(sys.argv[1])
        check_log_and_stream(Path(sys.argv[2]))
