# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3 (ipykernel)
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Sensor errors and the Allan deviation
#
# A data sheet is a page of numbers in five different units. A simulated sensor needs the same numbers in one.
# And a sensor on your desk has numbers that nobody wrote down. This notebook goes from the sheet to the
# simulated sensor and back again, and then from a log of your own to a card of your own.
#
# The tour, `01_tour.py`, has introduced noise and bias.

# %%
import tempfile
from pathlib import Path

import holoviews as hv
import numpy as np
import pandas as pd
import panel as pn

from lab import Experiment, allan, card, check, earth, plots
from lab.analysis import rest
from lab.sensors import imu
from lab.sensors.suite import SensorSuite
from lab.views.allan import AllanFigures

hv.extension("bokeh", inline=pn.config.inline)
plots.follow_theme()
pn.extension()
plots.fit_phones()
pd.set_option("display.max_colwidth", None)

NO_LONG_DRAWS = {"instability": False, "flicker": False, "walk": False}  # white noise only

# %% [markdown]
# ## 1. From a data sheet to settings
#
# A *card* of the lab holds the numbers of a data sheet as they are printed, each with its unit and its
# source. The settings are in one unit. Two conversions go wrong more often than all others:
#
# - **°/√h or °/s/√Hz.** An angle random walk of 1 °/√h is 1/60 °/s/√Hz, for √3600 is 60. An hour has √h = 60
#   √s.
# - **One-sided or two-sided.** A noise density on a sheet is that of a spectrum over positive frequencies
#   only. The angle walks with the two-sided density, which is smaller by √2. A random walk in °/√h needs no
#   such factor.

# %%
chosen = card("ADIS16470")
settings = SensorSuite().update(chosen.settings())
pd.DataFrame(
    [
        (f"{triad} {name}", datum.value, datum.unit, datum.density, getattr(getattr(settings, triad), name))
        for triad in ("gyro", "accelerometer")
        for name, datum in chosen.terms[triad].items()
    ],
    columns=["term", "on the sheet", "unit", "density", "setting (x, y, z)"],
)

# %%
check("03.1")

# %% [markdown]
# **Try:** `settings.gyro` shows all settings with their units. Which errors does the sheet leave out?
# `chosen.assumed["gyro"]` has what the lab assumes for them, with its reasons.
#
# ## 2. What white noise does
#
# White noise of density N makes the angle walk: its σ after a time t is **N √t**. No averaging removes it,
# for it has already been added up. Here are three gyros at rest, all from the same draws, and the two curves
# ±N √t.


# %%
def walk(density):
    """Return the angle errors of three gyros at rest over 100 s [°]."""
    errors = imu.GyroErrors(noise_density=density, bias_sigma=0)
    draws = imu.ImuDraws.of(3, "gyro", 2000, **NO_LONG_DRAWS)
    angle = np.degrees(np.cumsum(imu.measure(np.zeros((2000, 3)), 0.05, errors, draws).increments, axis=0))
    t = 0.05 * np.arange(1, 2001)
    curves = [hv.Curve((t[::10], angle[::10, axis]), "time [s]", "angle [°]") for axis in range(3)]
    band = hv.Area(
        (t[::10], -density * np.sqrt(t[::10]), density * np.sqrt(t[::10])), "time [s]", ["angle [°]", "high"]
    )
    return (hv.Overlay(curves) * band.opts(alpha=0.15, line_alpha=0)).opts(
        width=660, height=280, show_grid=True
    )


density = pn.widgets.FloatSlider(
    label="Gyro noise [°/s/√Hz]", start=0.001, end=0.1, step=0.001, value=0.05, format="0.000"
)
pn.Column(density, pn.bind(walk, density.param.value_throttled))

# %%
check("03.2")

# %% [markdown]
# ## 3. The Allan deviation
#
# How much do two neighbouring means of length τ differ? This is the **Allan deviation** σ(τ), and its slope
# on logarithmic axes says which noise there is:
#
# | slope | term | read it |
# |---|---|---|
# | −1/2 | white noise N | at τ = 1 s |
# | 0 | bias instability (flicker) B | the floor is 0.664 B |
# | +1/2 | random walk K of the bias | at τ = 3 s, on the line |
#
# A larger τ averages the white noise away, and uncovers how the bias wanders. There is a best time to average
# over, at the floor. Averaging longer makes it worse. The dashed curves are what the settings promise.

# %%
noise = pn.widgets.FloatSlider(
    label="White noise N [°/s/√Hz]", start=0.001, end=0.02, step=0.001, value=0.005, format="0.000"
)
flicker = pn.widgets.FloatSlider(label="Flicker B [°/h]", start=0, end=40, step=1, value=8)
random_walk = pn.widgets.FloatSlider(label="Random walk K [°/h/√h]", start=0, end=200, step=5, value=0)


def deviation(noise, flicker, random_walk):
    """Return the Allan deviations of the sensors with other gyros, simulated at rest for some hours."""
    sensors = SensorSuite().update(settings.to_dict())
    sensors.gyro.noise_density = noise
    sensors.gyro.flicker = flicker
    sensors.gyro.rate_random_walk = random_walk
    figures = AllanFigures()
    records = rest.simulate(sensors, seed=1)
    figures.show(sensors, {triad: allan.deviation(one.rates, one.dt) for triad, one in records.items()})
    plots.follow_theme(*figures.figures)
    width = 480 if plots.columns(2) > 1 else 360  # px; one below the other on a phone
    return pn.FlexBox(*(pn.pane.Bokeh(figure, width=width, height=320) for figure in figures.figures))


knobs = (noise, flicker, random_walk)
page = pn.Column(
    "# Allan deviation of a sensor at rest",
    pn.FlexBox(*knobs),
    pn.bind(deviation, *(knob.param.value_throttled for knob in knobs)),
)
page.servable(title="Allan deviation of a sensor at rest")

# %%
check("03.3")

# %% [markdown]
# **Try:** set B to 0 and K to 100. Where does the random walk begin to show? For how long would you average
# the gyros at rest before a flight?
#
# ## 4. And back again
#
# The lab fits five terms at once, by least squares with the covariance of the estimates, for neighbouring
# averaging times share their data. Each term has a σ. A term below twice its σ is not shown by the record.
# Here the simulated ADIS16470 is fitted, and its card comes out again.

# %%
records = rest.simulate(settings, seed=1)
terms = rest.in_setting_units("gyro", rest.noise_terms(records)["gyro"])
pd.DataFrame(
    {
        name: {
            "fitted, x": terms[name]["value"][0],
            "σ": terms[name]["sigma"][0],
            "set": getattr(settings.gyro, name)[0],
            "unit": terms[name]["unit"],
        }
        for name in ("noise_density", "flicker", "rate_random_walk")
    }
).T

# %% [markdown]
# The record of the gyros lasts four hours. A shorter one would show N just as well, but not B: at the
# longest τ there are only a few independent means. Here are the ends of the 95 % interval of the deviation,
# at some averaging times.

# %%
gyro = allan.deviation(records["gyro"].rates, records["gyro"].dt)
low, high = gyro.interval()
pd.DataFrame(
    {"deviation [°/h]": gyro.deviation[::8, 0], "low": low[::8, 0], "high": high[::8, 0]},
    index=pd.Index(gyro.tau[::8].round(1), name="τ [s]"),
).mul([np.degrees(3600)] * 3).round(2)

# %% [markdown]
# ## 5. A log of your own
#
# Leave your IMU on a stone floor over night, at an even temperature, and log `t_s,gx_rad_s,…,fz_m_s2`. Here
# the lab pretends to be such an IMU, one of which you know nothing, at two samples a second for three hours.
# It is written to a csv file and read back. (A real one sends 100 or more a second: the same, with a file of
# 100 MB.)

# %%
folder = Path(tempfile.mkdtemp())
samples, dt = 21_600, 0.5
unknown = SensorSuite()
unknown.gyro.noise_density, unknown.gyro.flicker, unknown.gyro.bias_sigma = 0.02, 60, 0.3
unknown.accelerometer.noise_density, unknown.accelerometer.bias_sigma = 80, 5
output = [
    imu.measure(
        np.tile(still, (samples, 1)) * dt,
        dt,
        errors,
        imu.ImuDraws.of(7, triad, samples, **(NO_LONG_DRAWS | {"flicker": True})),
    ).increments
    / dt
    for triad, errors, still in (
        ("gyro", unknown.gyro, np.array([4e-5, 0, -6e-5])),  # the rotation of the Earth [rad/s]
        ("accelerometer", unknown.accelerometer, np.array([0, 0, -earth.STANDARD_GRAVITY])),
    )
]
table = pd.DataFrame(
    np.column_stack((dt * np.arange(samples), *output)),
    columns=["t_s", "gx_rad_s", "gy_rad_s", "gz_rad_s", "fx_m_s2", "fy_m_s2", "fz_m_s2"],
)
table.to_csv(folder / "night.csv", index=False, float_format="%.9g")
table.head(3)

# %% [markdown]
# `rest.read_log` checks the clock, the unit and that nothing moved. `rest.card_of` fits all axes and makes a
# card, which is a TOML file like all others. In a terminal, `ins-lab allan night.csv --card mine.toml` does
# the same.

# %%
night = rest.read_log(folder / "night.csv")
mine = rest.card_of("mine", night, "night.csv")
(folder / "mine.toml").write_text(mine.to_toml(), encoding="utf-8")
pd.DataFrame(
    [
        (triad, name, datum.value, datum.unit)
        for triad, terms in mine.terms.items()
        for name, datum in terms.items()
    ],
    columns=["triad", "term", "fitted (x, y, z)", "unit"],
)

# %% [markdown]
# Now fly with it.

# %%
experiment = Experiment(mission="los_angeles", seed=1)
experiment.trajectory.imu_rate = 20  # Hz: this flight does not shake
card(folder / "mine.toml").load(experiment)
plots.sensor_errors(experiment.run())

# %% [markdown]
# ## 6. What a record at rest does not show
#
# The plots above have no turn-on bias: the card has none. The Allan deviation takes differences of means, so
# a constant cancels. Scale factors and misalignments need motion, and the bias that changes with temperature
# needs a heater. These numbers must come from the sheet, from a turntable, or from the flight itself.

# %%
shifted = allan.deviation(night["gyro"].rates + np.radians(5), dt)
same = np.allclose(shifted.deviation, allan.deviation(night["gyro"].rates, dt).deviation)
print(f"a bias of 5 °/s more, and the deviation is the same: {same}")
check("03.4")

# %% [markdown]
# **Try:** give the card a turn-on bias in the text of the TOML file, load it, and fly again. How long does
# the filter need to find it?
#
# ## Where to go next
#
# - `docs/sensors.md`: all errors, and the form of a card.
# - `lab/analysis/allan.py`: the estimate, its degrees of freedom and the fit, with references.
# - `11_live.py`: a log from a sensor on the desk; the page *Live* draws its Allan deviation as it comes.
