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
# # A tour of INS Lab
#
# An **inertial navigation system** measures how a vehicle turns and accelerates, and adds this up to know
# where it is. It needs no signal from outside, but its errors add up too. **GPS** gives the position to about
# a metre, at any time, but only once a second and only while it is received. A **Kalman filter** combines the
# two.
#
# In ten minutes you will fly a Cessna over Montréal, put cheap sensors into it, navigate, and see how good
# the solution is and why. Run the cells from top to bottom. Each step has one idea, and one question to try.

# %%
import panel as pn

from lab import Experiment, check, mission, plots

pn.extension()
plots.fit_phones()

# %% [markdown]
# ## 1. A flight
#
# A *mission* is a flight with a name. Its *flight recording* holds position, velocity and attitude, about
# eighteen times a second. An autopilot flew this one in the flight simulator JSBSim. The lab draws one smooth
# curve through these samples. That curve is the **truth**: everything below is compared with it.

# %%
mission("montreal")

# %% [markdown]
# **Try:** `mission("los_angeles")` is shorter. Which of the two banks more steeply? (Look at *Roll*.)
#
# ## 2. Sensors that err
#
# An *experiment* holds every setting of one run: the flight, the errors of the sensors, the assumptions of
# the filter, and the seed of all random numbers. Each setting has a unit and bounds: the Tab key lists them
# after `experiment.sensors.gyro.`, and `experiment.sensors.gyro` shows those of the gyros. The defaults are
# those of the MEMSense AccelRate3D, a small MEMS sensor.

# %%
experiment = Experiment(mission="montreal", seed=1)
result = experiment.run()

experiment.sensors.gyro

# %% [markdown]
# Two errors of gyros matter most. **White noise** disturbs every sample; its density, in °/s/√Hz, says how
# fast the angle drifts away in a random walk. A **bias** is a constant that is different each time the sensor
# is switched on. The filter does not know this constant. The dashed line is the true bias of the sensor, the
# solid line is the filter's estimate, and the band is its uncertainty (±3σ).

# %%
plots.sensor_errors(result)

# %% [markdown]
# **Try:** the filter finds the bias of the vertical gyro, z, suddenly. What does the aeroplane do then?
# `result.truth.attitude.sel(angle="roll").plot()` shows it. Which bias does the filter hardly find at all?
#
# ## 3. A navigation solution
#
# The navigator turns angle increments into attitude, attitude and velocity increments into velocity, and
# velocity into position, 200 times a second. At each GPS fix the filter compares, and corrects. Seen from
# above, the estimate and the truth look the same, while the fixes scatter about them.

# %%
plots.ground_track(result)

# %%
plots.height(result)

# %% [markdown]
# To see how good the solution is we need the *errors*: **estimate minus truth**. The table gives their root
# mean square, the largest, and the value that 95 % of them stay below.

# %%
result.summary

# %% [markdown]
# Everything in a result is a labelled dataset of [xarray](https://xarray.dev) with units: `result.errors`,
# `result.sigma`, `result.imu`, `result.gps`, … You can slice, plot and save each of them. `result.plot.`
# and the Tab key list the plots, and `result.explore()` has all of them in tabs.
#
# **Try:** `result.errors.position.sel(axis="up").plot()`. How large is the height error at the end?
#
# ## 4. The filter knows how large its errors may be
#
# A Kalman filter gives not only an estimate but also its standard deviation σ. The plots show the errors of
# position, velocity and attitude with the band ±3σ. An honest filter keeps its error inside nearly always,
# and makes the band no wider than necessary.

# %%
plots.errors(result)

# %% [markdown]
# Look at the heading. At rest and in straight flight its band does not close: GPS measures position and
# velocity, and a heading error shows in neither while the aircraft does not accelerate sideways. In the first
# turn, about 50 s after the start, it shows at once. **What is not moved is not observed**: this is the most
# useful sentence of the whole field.

# %%
plots.covariance(result)

# %% [markdown]
# `check` asks a question. Write your answer behind its number, in quotes if it is a word, and run the cell
# again.

# %%
check("01.1")

# %% [markdown]
# **Try:** when does σ of the heading fall fastest? Compare with the roll angle:
# `result.truth.attitude.sel(angle="roll").plot()`.
#
# ## 5. Turn the knob
#
# Now change the sensor. The slider sets the density of the gyros' white noise. It only scales the same
# random numbers, so the curves change smoothly and do not jump. A run takes less than a tenth of a second:
# the lab navigates again as soon as you let the slider go.

# %%
noise = pn.widgets.FloatSlider(
    label="Gyro noise [°/s/√Hz]", start=0.0, end=0.3, step=0.005, value=0.05, format="0.000"
)


def with_gyro_noise(density):
    """Return the error plots of the experiment with another gyro."""
    trial = experiment.copy()
    trial.sensors.gyro.noise_density = density
    return plots.errors(trial.run())


pn.Column(noise, pn.bind(with_gyro_noise, noise.param.value_throttled))

# %% [markdown]
# **Try:** at 0.2 °/s/√Hz, four times the noise, how much worse is the heading, and how much the position? Why
# does the position hardly change?
#
# ## 6. Lie to the filter
#
# Until here the filter knew the true statistics of its sensors. In practice nobody does. `r_scale` multiplies
# the GPS noise that the filter *assumes*, while the receiver stays as it is. An **innovation** is the
# difference between the filter's prediction and a fix. The innovations reveal the lie: 99.7 % of them should
# lie inside ±3σ, and none should predict the next.

# %%
belief = pn.widgets.DiscreteSlider(label="The filter believes R ×", options=[0.01, 0.1, 1, 10, 100], value=1)


def with_belief(scale):
    """Return the innovations of a filter that believes in another GPS."""
    trial = experiment.copy()
    trial.navigator.r_scale = scale
    return plots.innovations(trial.run())


pn.Column(belief, pn.bind(with_belief, belief.param.value_throttled))

# %% [markdown]
# **Try:** with R × 0.01 the filter assumes a tenth of the true GPS noise σ. Where are the innovations now,
# compared with their band? And with R × 100, why do they change so slowly?
#
# ## 7. Without GPS
#
# In a tunnel, under a bridge or near a jammer there are no fixes. The inertial system goes on alone, and the
# filter says how its uncertainty grows with every second.

# %%
outage = pn.widgets.IntSlider(label="No GPS from 90 s, for [s]", start=0, end=60, step=5, value=30)


def without_gps(seconds):
    """Return the error plots of a flight with a gap in its fixes."""
    trial = experiment.copy()
    trial.sensors.gps.outages = [(90, 90 + seconds)] if seconds else []
    return plots.errors(trial.run())


pn.Column(outage, pn.bind(without_gps, outage.param.value_throttled))

# %% [markdown]
# **Try:** double the outage from 30 to 60 s. Does the position error double, grow fourfold, or more?

# %%
check("01.2")

# %% [markdown]
# ## 8. In three dimensions
#
# The scene shows the true path, the estimated path, the fixes, and the filter's 3σ ellipsoids of its position
# (ten times enlarged). Drag to turn, scroll to zoom. This scene is a page of its own that needs no server. In
# the dashboard it is live, and the aircraft flies.

# %%
result.view3d()

# %% [markdown]
# ## 9. A page of your own
#
# A few widgets and plots make a page. The sliders are those of steps 5 to 7 and now act together: a slider
# that you move here moves above too. In a terminal, `panel serve` with the path of this file, such as
# `panel serve my_notebooks/01_tour.ipynb`, shows exactly this cell to anyone with a browser.


# %%
def navigate(density, scale, seconds):
    """Run the experiment with all three knobs turned."""
    trial = experiment.copy()
    trial.sensors.gyro.noise_density = density
    trial.navigator.r_scale = scale
    trial.sensors.gps.outages = [(90, 90 + seconds)] if seconds else []
    return trial.run()


def show(view):
    """Return a plot that follows the three widgets."""
    knobs = (widget.param.value_throttled for widget in (noise, belief, outage))
    return pn.bind(lambda *values: view(navigate(*values)), *knobs)


pn.Column(
    "# A tour of INS Lab",
    pn.FlexBox(noise, belief, outage),
    pn.Tabs(
        ("Errors", show(plots.errors)),
        ("Innovations", show(plots.innovations)),
        ("Ground track", show(plots.ground_track)),
        dynamic=True,
    ),
).servable(title="A tour of INS Lab")

# %% [markdown]
# **Try:** no GPS for 60 s. How much smaller does the error become with a better gyro, and what is left when
# the noise is zero?
#
# ## Where to go next
#
# - `02_strapdown.py` to `11_live.py`: one subject each, with questions. `ins-lab notebooks list` names them.
# - `print(experiment.to_toml())`: the settings as a file; `result.to_netcdf("run.nc")`: all datasets.
# - `missions/README.md`: navigate a flight of your own, from a csv file.
# - `docs/README.md`: every subject on a page of its own.
# - `ins-lab serve`: the dashboard, with every setting and all plots linked.
# - `import lab; help(lab)`: the conventions of the lab: frames, units and signs.
