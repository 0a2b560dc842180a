"""What the prose of the notebooks states, each with an expression that holds after the notebook has run."""

from __future__ import annotations

CLAIMS: dict[str, dict[str, str]] = {
    "01_tour": {
        "eighteen times a second": "abs(1 / np.diff(mission('montreal').recording.time).mean() - 18) < 0.5",
        "In the first turn, about 50 s after the start, it shows at once": (
            "heading(45) > 1.9 and heading(56) < 1.0"
        ),
        "the filter finds the bias of the vertical gyro, z, suddenly": "gyro_z(58) < 0.45 * gyro_z(46)",
    },
    "02_strapdown": {
        "it follows a flight of 205 s to some micrometres": "1 < 1e6 * miss(200) < 10",
        "after 300 s they are already 1 % off": (
            "abs(at_rest(300, accelerometer=1)[300] / (0.5e-3 * G * 300**2) - 0.99) < 0.005"
        ),
        "at most 2 b R/g, 13 km for 1 mg": "abs(at_rest(4000, accelerometer=1).max() / 1e3 - 13) < 0.5",
        "111 km in an hour for 1 °/h": "abs(at_rest(5064, gyro=1)[5064] / 5064 * 3.6 - 111) < 4",
        "find the accelerometer error that cancels the swing": (
            "np.abs(at_rest(10_800, 1.7, 0, 0.1)).max() < np.abs(at_rest(10_800, 0, 0, 0.1)).max() / 5"
        ),
        "Some 3 km are left": "2500 < np.abs(at_rest(10_800, 1.7, 0, 0.1)).max() < 3500",
        "content with 10 to 20 Hz": "miss(20) < 0.05 < miss(10) < 0.2 < miss(5)",
        "drifts by 25 °/h at 50 samples a second": "abs(coning_drift(0.1, 20, 50, True) + 25) < 0.5",
        "and by 0.2 °/h at 200": "abs(coning_drift(0.1, 20, 200, True) + 0.2) < 0.02",
        "With 40 samples a second the gyros seem to swing to and fro along a line": (
            "abs(coning_drift(0.1, 20, 40, True) - coning_drift(0.1, 20, 40, False)) < 0.01"
        ),
        "with fewer the other way round": (
            "coning_drift(0.1, 20, 30, True) < coning_drift(0.1, 20, 30, False) - 1"
        ),
    },
    "03_sensor_errors": {
        "The record of the gyros lasts four hours": (
            "abs(records['gyro'].rates.shape[0] * records['gyro'].dt / 3600 - 4) < 0.3"
        ),
        "The lab fits five terms at once": "len(terms) == 5",
        "The plots above have no turn-on bias": "not np.any(experiment.sensors.gyro.bias_sigma)",
    },
    "04_filter": {
        "turns some seven hundred times faster": (
            "abs(0.1 / (np.degrees(earth.RATE) * np.radians(2)) - 700) < 50"
        ),
        "Four blocks are enough for this sensor": "abs(rms('four blocks') / rms('all of F') - 1) < 0.01",
        "Its σ of the attitude grows too": "honest(runs['without velocity from tilt'], 'attitude') < 3",
        "but that of the position does not": "honest(runs['without velocity from tilt'], 'position') > 100",
        "brings more states, which these forty lines do not have": "(better_differences < 1e-9).all()",
    },
    "05_tuning": {
        "Q wrong by a factor of 10 in either direction hardly changes it": (
            "all(abs(numbers(run(q_scale=factor))['NIS'] / 6 - 1) < 0.15 for factor in (0.1, 10))"
        ),
        "With Q ten times too large, **nothing shows without the truth**": (
            "'Consistent' in str(run(q_scale=10).innovation_verdict) and 'Q' in str(run(q_scale=10).verdict)"
        ),
        "Only a factor of 100 makes them alternate a little": (
            "'alternate' in str(run(q_scale=100).innovation_verdict)"
        ),
        "here a factor of 100 on its variances costs 5 cm": (
            "abs(position(run(p0_scale=100)) - position(matched) - 0.05) < 0.005"
        ),
        "a factor of 1/100 costs more than a metre": "position(run(p0_scale=0.01)) - position(matched) > 1",
        "it is silent about Q and P₀ that are ten times too large": (
            "'Consistent' in str(run(p0_scale=10).innovation_verdict)"
        ),
        "one changes nothing but what the filter says of itself": "same",
    },
    "06_error_models": {
        "Where errors are small, all agree": "max(row.position for row in rows) < 1.01 * rows[0].position",
        "All four find the heading only in the first turn, from 10 to 18 s": (
            "all(misses(model, 9) > 50 and misses(model, 18) < 3 for model in MODELS)"
        ),
        "phi computes it from its own attitude": (
            "table['phi']['NEES, expected 15'] > 1.5 * table['invariant']['NEES, expected 15']"
        ),
        "and soon no linear model holds": (
            "position_rms(corrected('feedforward', 0.3)) > 20 * position_rms(corrected('feedback', 0.3))"
        ),
    },
    "07_outages": {
        "From 30 to 60 s the error grows some 4.5 times": (
            "abs(np.divide(*(np.sqrt(np.mean(np.square(runs[s]), axis=0))[0] for s in (60, 30))) - 4.5) < 0.2"
        ),
        "They agree as well as eight runs can": (
            "all(abs(np.divide(*np.sqrt(np.mean(np.square(runs[s]), axis=0))) - 1) < 0.25 for s in lengths)"
        ),
        "Which bias has a much larger share than above": (
            "float(end.share.sel(quantity='position up', source='accelerometer turn-on bias σ'))"
            " > 3 * share['accelerometer turn-on bias σ']"
        ),
        "The first turn takes a third off the error after 30 s": (
            "abs(at(found[64], 94)[1] / at(found[30], 60)[1] - 2 / 3) < 0.03"
        ),
    },
    "08_own_flight": {
        "nine times a second": "abs(1 / np.diff(table.time_s).mean() - 9) < 0.2",
        "right to some 0.6° rms": "abs(np.sqrt(np.mean(off**2)) - 0.6) < 0.05",
        "the tag *attitude reconstructed*": "'attitude reconstructed' in added.tags",
        "Both flights give nearly the same errors": (
            "np.allclose(result.summary['rms'], from_phone.run().summary['rms'], rtol=0.06)"
        ),
    },
    "09_own_algorithm": {
        "A straight line is better": ("in_outage['extrapolate'] < in_outage['fixed gains']"),
        "and some degrees are left": "1 < np.degrees(1) * tilts.max() < 10",
        "why are these innovations never white, whatever S is": (
            "'correlated' in str(honest.innovation_verdict)"
        ),
    },
    "10_many_runs": {
        "The worst run is a fifth worse than the best": (
            "abs(position_rms(matched).max() / position_rms(matched).min() - 1.2) < 0.02"
        ),
        "So 91 % instead of 95 %": "round(100 * inside[0]) == 91",
        "makes the heading worse by only a third": "abs(mean[-1] / mean[0] - 4 / 3) < 0.02",
        "With the same seeds the filter is worse by 7 mm, at 2.7σ": (
            "round(1e3 * paired.mean()) == 7"
            " and abs(paired.mean() / (paired.std(ddof=1) / np.sqrt(20)) - 2.7) < 0.05"
        ),
        "one would need some thirty times as many runs": (
            "abs((unpaired / (paired.std(ddof=1) / np.sqrt(20))) ** 2 - 30) < 3"
        ),
    },
    "11_live": {
        "with 100 samples per second": "abs(status.rate - 100) < 1",
        "to the last bit": "replayed.imu.tobytes() == samples.tobytes()",
        "Without a heading it does not claim one": "'heading' in phases['attitude only'][1]",
        "from then on it navigates": "phases['navigating'][0] > 20 and navigator.state.phase == 'navigating'",
    },
}
"""For each notebook: a phrase of its prose, and an expression of the notebook's names that makes it true."""


HELPERS = {
    "01_tour": """
import numpy as np
def heading(time):
    return float(result.sigma.attitude.sel(angle="heading").sel(time=time, method="nearest"))
def gyro_z(time):
    return float(result.sensor_errors.gyro_bias_sigma.sel(time=time, method="nearest")[2])
""",
    "04_filter": """
from lab import card
from lab.motion.frames import earth
def rms(name):
    return float(np.sqrt((runs[name].errors.position**2).sum("axis").mean()))
card("STIM300").load(experiment)
fewer = {"estimate_misalignments": False, "estimate_g_sensitivity": False}
experiment.update({"navigator": {"states": 15, "alignment": 0, **fewer}})
believed = belief(experiment.sensors, experiment.navigator)
better_differences = differences(experiment.run(), experiment.run(algorithm=OpenFilter())).loc["difference"]
""",
    "05_tuning": """
def position(result):
    return numbers(result)["position, rms [m]"]
""",
    "06_error_models": """
def misses(model, time):
    return abs(float(lost(model).errors.attitude.sel(angle="heading").sel(time=time, method="nearest")))
""",
    "09_own_algorithm": """
in_outage = race(sensors__gps__outages=[(60.5, 80.5)]).set_index("algorithm")["position [m]"]
tilts = np.radians(experiment.run(algorithm=FixedGains()).summary["rms"][6:8])
""",
}
"""What the expressions of a notebook need beside its own names."""
