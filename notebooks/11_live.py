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
# # A sensor, live
#
# So far the laboratory has computed whole flights at once. A real sensor sends a sample now, and the next one
# a few milliseconds later. This notebook receives such a stream, records it, and navigates with it.
#
# You need no hardware: the **simulated device** flies a mission and sends what its sensors measure, through
# the protocol of a real device, in real time. Everything below works in the same way with a sensor on the
# desk. Only the address changes, for example to `serial:/dev/ttyUSB0?baud=115200`.

# %%
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import panel as pn

import lab.live
from lab import Experiment, check, plots
from lab.data.streams.recorded_log import log_of_recording, recorded_samples
from lab.live.live_navigator import LiveNavigator
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.views.live_figures import LiveFigures

pn.extension()
plots.fit_phones()
pd.set_option("display.max_colwidth", None)

# %% [markdown]
# ## 1. Open a source
#
# A source has an address. This one flies *Montréal* as a VectorNav, with 100 samples per second. It has a
# thread of its own, which ends with the `with` block. The status says what the thread found out: the protocol
# and the evidence for it, how the samples are timed, and what was lost on the way.

# %%
folder = Path(tempfile.mkdtemp())
with lab.live.open("simulated:montreal?device=vectornav&hz=100") as source:
    source.record(folder / "first.inslab")
    while source.status.samples < 800:  # 8 s
        time.sleep(0.1)
    status = source.status

pd.Series(
    {
        "state": status.state,
        "protocol": status.protocol,
        "evidence": status.evidence,
        "timing": status.timing,
        "rate [Hz]": round(status.rate, 1),
        "clock drift [ppm]": round(1e6 * status.drift, 1),
        "samples": status.samples,
        "missing": status.loss.missing,
    }
)

# %% [markdown]
# **Try:** put `&device=text` in place of `&device=vectornav`. What is the evidence now, and why is it weaker?
#
# ## 2. Read the samples
#
# `source.since(cursor)` returns what came after a cursor, and the next cursor. Each sample has the time of
# the device's clock, mapped to the clock of this computer. The mapping looks at the *least* delay within a
# second: bytes can arrive late, but never early. So the times are far more regular than the arrivals.

# %%
samples = source.since().imu
table = pd.DataFrame(
    {
        "σ of the intervals [ms]": [
            1e3 * np.diff(samples["arrival"])[200:].std(),
            1e3 * np.diff(samples["time"])[200:].std(),
        ]
    },
    index=["arrivals", "mapped times"],
)
table

# %% [markdown]
# **Try:** open the source with `&jitter_ms=20`. Which of the two rows changes?

# %%
check("11.1")

# %%
check("11.2")

# %% [markdown]
# ## 3. Replay, bit by bit
#
# A recording holds the raw bytes and the times of their arrival. A replay goes through the same decoder, so
# it gives the same samples to the last bit, as often as you like. `?speed=max` does not wait.

# %%
replayed = recorded_samples(folder / "first.inslab")
pd.Series(
    {
        "samples": len(replayed.imu),
        "the same bits": replayed.imu.tobytes() == samples.tobytes(),
        "size [kB]": (folder / "first.inslab").stat().st_size // 1000,
    }
)

# %% [markdown]
# ## 4. Navigate as it comes
#
# The live navigator runs the very same compiled step as a batch run. At rest, it levels and finds the gyro
# biases. Without a heading it does not claim one: cheap gyros cannot find north. The first course over ground
# shows the heading, and from then on it navigates. Here it is fed with two minutes of a flight, without
# waiting.

# %%
flight = SimulatedFlight.of("montreal", 100.0, rest=15.0)
imu, fix = flight.timed()
imu, fix = imu[:12_000], fix[:120]

experiment = Experiment()
navigator = LiveNavigator(experiment.sensors, experiment.navigator)
phases = {}
for begin in range(0, len(imu), 10):
    now = imu["time"][begin + 9]
    due = fix[(fix["time"] <= now) & (fix["time"] > now - 0.1)]
    navigator.feed(imu[begin : begin + 10], due)
    phases.setdefault(navigator.state.phase, (round(float(now), 1), navigator.state.reason))

pd.DataFrame(phases, index=["since [s]", "reason"]).T

# %%
state = navigator.state
truth = flight.result.truth_arrays
pd.DataFrame(
    {
        "estimate [°]": np.degrees(state.euler),
        "σ [°]": np.degrees(state.euler_sigma),
        "truth [°]": np.degrees(truth.euler[len(imu)]),
    },
    index=["roll", "pitch", "heading"],
).round(2)

# %% [markdown]
# **Try:** give the heading before the start: `experiment.navigator.initial_heading = -137`. When does it
# navigate now?
#
# ## 5. Look at it
#
# These are the plots of the page *Live*, filled once. On the page they roll.

# %%
figures = LiveFigures()
figures.widen(120.0)
figures.add_history(navigator.since()[1], 0.0)
figures.add_fixes(fix)
figures.show(state, 120.0)
plots.follow_theme(*figures.figures)
for figure in figures.figures:
    figure.update(sizing_mode="fixed", width=380, height=250)
    figure.title.text_font_size = "9pt"
pn.Column("# A sensor, live", pn.FlexBox(*figures.figures[2:])).servable(title="A sensor, live")

# %% [markdown]
# ## 6. Keep it
#
# A recording with an IMU and fixes is also a sensor log. The batch navigates it, smooths it and judges it, as
# any other log. On the command line, `ins-lab live record SOURCE NAME` does both steps.

# %%
log_of_recording(folder / "first.inslab")

# %% [markdown]
# **Try:** in a terminal, `ins-lab live simulate montreal --device mip --to tcp:5555` sends a flight. Open it
# here with `lab.live.open("tcp:127.0.0.1:5555")`, and stop the sender while you read. What does the status
# say?
