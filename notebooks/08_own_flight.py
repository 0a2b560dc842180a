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
# # Bring your own flight
#
# The flights that ship with the lab are three. Yours is more interesting: from a flight simulator, a logger,
# a phone, an autopilot. This notebook brings one in, finds out whether it can be true, and navigates along
# it. It makes its files itself, in a temporary folder, and writes nowhere else. Put the path of your own file
# in their place.

# %%
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import panel as pn

from lab import Experiment, MissionError, check, mission, plots
from lab.missions import prepare_import

pn.extension()
plots.fit_phones()
folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## 1. A file
#
# The plainest format is the lab's own flight csv: one row per sample, the unit in the name of each column.
# Somebody has logged a flight over Montréal, nine times a second.

# %%
flown = mission("montreal").recording
rows = slice(None, None, 2)
table = pd.DataFrame(
    {
        "time_s": flown.time[rows],
        "latitude_deg": np.degrees(flown.latitude[rows]),
        "longitude_deg": np.degrees(flown.longitude[rows]),
        "height_m": flown.height[rows],
        "velocity_north_m_s": flown.velocity_n[rows, 0],
        "velocity_east_m_s": flown.velocity_n[rows, 1],
        "velocity_down_m_s": flown.velocity_n[rows, 2],
        "roll_deg": np.degrees(flown.euler[rows, 0]),
        "pitch_deg": np.degrees(flown.euler[rows, 1]),
        "yaw_deg": np.degrees(flown.euler[rows, 2]),
    }
)
table.to_csv(folder / "flight.csv", index=False, float_format="%.9g")
table.head(3).round(4)

# %% [markdown]
# The format of a file is found from its content, not from its name. `docs/importing.md` lists those there
# are: X-Plane, Microsoft Flight Simulator, FlightGear, PX4, ArduPilot, Garmin, IGC, GPX and more.
#
# ## 2. The report
#
# `prepare_import` reads, repairs and rebuilds. It adds nothing yet. Its report is worth reading: what was
# found, how fine the clock and the numbers are, how noisy the motion is, and whether position, velocity,
# attitude and rates agree.

# %%
read = prepare_import(folder / "flight.csv")
read.report

# %% [markdown]
# **Try:** write the table with `float_format="%.6g"`. What does the report say of the position, and what
# would an accelerometer on such a flight feel?
#
# ## 3. What is wrong is found
#
# Files lie. A velocity in knots under a name with `m_s`, a roll with the wrong sign: a navigator would make
# nonsense of both, so the lab compares. The derivative of the position must be the velocity, and an aircraft
# that turns to the right banks to the right.

# %%
knots = table.copy()
knots[["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"]] /= 0.5144
knots.to_csv(folder / "knots.csv", index=False, float_format="%.9g")
mirrored = table.assign(roll_deg=-table.roll_deg)
mirrored.to_csv(folder / "mirrored.csv", index=False, float_format="%.9g")

answers = {}
for name in ("knots", "mirrored"):
    try:
        found = prepare_import(folder / f"{name}.csv").report
        answers[name] = " ".join([f"{found.verdict}:", *found.reasons])
    except MissionError as error:
        answers[name] = str(error).partition("csv, ")[2]
pd.set_option("display.max_colwidth", None)
pd.Series(answers).to_frame("what the lab says")

# %%
check("08.1")

# %% [markdown]
# **Try:** swap latitude and longitude, or shift the times by making every tenth row late by 50 ms. Which of
# your lies are found, and which are repaired?
#
# ## 4. A track with nothing but positions
#
# A phone writes a GPX file: position and height, once a second. There is no attitude in it. For an aeroplane
# there is a way out: in a coordinated turn, the lift points along the vertical axis of the aircraft, so the
# bank follows from speed and turn rate, **tan φ = v ω/g**.

# %%
second = slice(None, None, 18)
places = zip(
    flown.time[second],
    np.degrees(flown.latitude[second]),
    np.degrees(flown.longitude[second]),
    flown.height[second],
    strict=True,
)
points = "".join(
    f'<trkpt lat="{latitude:.7f}" lon="{longitude:.7f}"><ele>{height:.2f}</ele>'
    f"<time>2026-01-01T00:{int(time) // 60:02d}:{time % 60:06.3f}Z</time></trkpt>"
    for time, latitude, longitude, height in places
)
gpx = '<gpx version="1.1" creator="me" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
(folder / "track.gpx").write_text(f"{gpx}{points}</trkseg></trk></gpx>", encoding="utf-8")

track = prepare_import(folder / "track.gpx")
guessed = np.degrees(np.interp(flown.time, track.recording.time, track.recording.euler[:, 0]))
off = guessed - np.degrees(flown.euler[:, 0])
pd.Series(
    {
        "how it was rebuilt": track.origin,
        "largest bank in the flight [°]": round(float(np.degrees(np.abs(flown.euler[:, 0]).max())), 1),
        "reconstructed bank minus true, rms [°]": round(float(np.sqrt(np.mean(off**2))), 2),
    }
).to_frame("the track")

# %%
check("08.2")

# %% [markdown]
# The bank of this flight is right to some 0.6° rms, although no gyro was near. The report says so, and the
# mission gets the tag *attitude reconstructed*.
#
# ## 5. A mission
#
# A flight that is plausible becomes a mission: a TOML file, and its recording beside it. Without a folder it
# goes to your own missions, where the page and the command line find it by its name. Here it stays in the
# temporary folder.

# %%
mine = read.add("circuit", title="My circuit", folder=folder)
added = track.add("walk_in_the_sky", title="The same from a phone", folder=folder)
mine

# %% [markdown]
# ## 6. Navigate
#
# From here on it is a flight like any other. The lab draws a smooth curve through the recording: this is the
# truth. Then it simulates the sensors of *your* choice on it, and navigates.

# %%
experiment = Experiment(mission=str(mine.path), seed=1)
experiment.trajectory.imu_rate = 20  # Hz: this flight does not shake
result = experiment.run()
plots.ground_track(result)

# %%
from_phone = experiment.copy()
from_phone.mission = str(added.path)
pd.DataFrame(
    {
        "unit": result.summary["unit"],
        "rms, from the csv": result.summary["rms"],
        "rms, from the phone's track": from_phone.run().summary["rms"],
    }
).set_index(result.summary["quantity"]).round(3)

# %% [markdown]
# Both flights give nearly the same errors: for the question of how well a sensor navigates, even a phone's
# track is good enough. It would not do for vibration, which no such recording has.
#
# **Try:** `result.verdict`, and the flight with another sensor: `card("BMI270").load(experiment)`, from
# `lab`.
#
# ## 7. Your flight, with your sensor

# %%
density = pn.widgets.FloatSlider(
    label="Gyro noise [°/s/√Hz]", start=0, end=0.2, step=0.005, value=0.05, format="0.000"
)
variance = pn.widgets.FloatSlider(
    label="Position variance of a fix [m²]", start=0.1, end=20, step=0.1, value=0.5
)
seconds = pn.widgets.IntSlider(label="No GPS from 100 s, for [s]", start=0, end=60, step=5, value=0)


def navigate(density, variance, seconds):
    """Return the run with the chosen sensors."""
    trial = experiment.copy()
    trial.sensors.gyro.noise_density = density
    trial.sensors.gps.position_variance = variance
    trial.sensors.gps.outages = [(100.5, 100.5 + seconds)] if seconds else []
    return trial.run()


def show(view):
    """Return a plot that follows the sliders."""
    knobs = (knob.param.value_throttled for knob in (density, variance, seconds))
    return pn.bind(lambda *values: view(navigate(*values)), *knobs)


pn.Column(
    "# My flight",
    pn.FlexBox(density, variance, seconds),
    pn.Tabs(("Errors", show(plots.errors)), ("Ground track", show(plots.ground_track)), dynamic=True),
).servable(title="My flight")

# %% [markdown]
# ## Where to go next
#
# - `docs/importing.md`: what to switch on in each simulator, so that nothing has to be guessed.
# - `ins-lab import FILE --preview`: the same report in a terminal, with a picture.
# - `docs/logs.md`: if your file holds the data of a *real* IMU and GPS receiver, the lab navigates with these
#   and simulates nothing.
