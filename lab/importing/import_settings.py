"""Import settings: how a flight is rebuilt from the file of a simulator or logger."""

from __future__ import annotations

import param

from lab.flying.coordinated_turn import VEHICLES
from lab.repair.row_repair import MAX_BRIDGED_GAP
from lab.repair.time_repair import REPAIRED, TIME_STAMPS
from lab.setting_kinds import Quantity
from lab.settings import Settings

AUTO = "auto"
CURVES = ("velocity", "position", "air data")
"""Sources for the reconstruction of a flight."""


class ImportSettings(Settings):
    """Settings of the reconstruction of a flight; the report names the choices made for ``auto``."""

    curve = param.Selector(
        default=AUTO,
        objects=[AUTO, *CURVES],
        label="Curve from",
        doc="What the flight is rebuilt from. velocity: recorded velocity, integrated and held to the "
        "positions. "
        "position: a curve through the positions, differentiated. air data: airspeed, angle of attack, "
        "sideslip "
        "and attitude, plus the wind. auto takes what makes the least noise.",
    )
    time_stamps = param.Selector(
        default=REPAIRED,
        objects=list(TIME_STAMPS),
        label="Time stamps",
        doc="repaired: rounded, repeated or jittering stamps are replaced by the times that fit the "
        "stamps and the "
        "motion, where the motion bears them out. as recorded: stamps are believed.",
    )
    longest_gap = Quantity(
        2.0,
        unit="s",
        bounds=(0, MAX_BRIDGED_GAP),
        softbounds=(0.5, 30),
        step=0.5,
        label="Longest gap",
        doc="Longest pause between samples that is bridged; at a longer one the recording is cut, and "
        "its longest "
        "stretch is taken. Five usual steps are always bridged.",
    )
    smoothing = param.Selector(
        default=AUTO,
        objects=[AUTO, "none", "given"],
        label="Smoothing",
        doc="auto: as much as predicts left-out samples best, where noise asks for it. none: the curve "
        "goes through "
        "every sample. given: as much as the smoothing parameter says.",
    )
    smoothing_parameter = Quantity(
        0.05,
        unit="s³",
        bounds=(0, 1e6),
        softbounds=(0, 1),
        step=0.01,
        label="Smoothing parameter λ",
        doc="Weight of the curve's bending against its distance from the samples, with smoothing = given: "
        "Σ (y − g)² + λ ∫ g''² dt is made least. Of the positions, or of the velocity where that makes "
        "the curve.",
    )
    wind = param.Selector(
        default="fitted",
        objects=["fitted", "constant", "none"],
        label="Wind",
        doc="For a curve from air data. fitted: the constant wind with which the flight follows the recorded "
        "positions best; without positions there is none. constant: the wind given. none: still air.",
    )
    wind_from = Quantity(
        0.0,
        unit="°",
        bounds=(-360, 360),
        softbounds=(0, 360),
        step=5,
        label="Wind from",
        doc="True direction a constant wind comes from.",
    )
    wind_speed = Quantity(
        0.0,
        unit="m/s",
        bounds=(0, 150),
        softbounds=(0, 30),
        step=0.5,
        label="Wind speed",
        doc="Speed of a constant wind.",
    )
    vehicle = param.Selector(
        default=AUTO,
        objects=[AUTO, *VEHICLES],
        label="Vehicle",
        doc="What moved: decides what is plausible, and the attitude where none is recorded (an "
        "aircraft banks into "
        "its turns, a car follows the slope, a boat stays level). auto: what the file says, or else an "
        "aircraft.",
    )
    start_latitude = Quantity(
        0.0,
        unit="°",
        bounds=(-90, 90),
        step=0.1,
        label="Start, latitude",
        doc="Where the flight starts, if the file has no positions.",
    )
    start_longitude = Quantity(
        0.0,
        unit="°",
        bounds=(-180, 180),
        step=0.1,
        label="Start, longitude",
        doc="Where the flight starts, if the file has no positions.",
    )
    start_height = Quantity(
        0.0,
        unit="m",
        bounds=(-1000, 100_000),
        softbounds=(0, 12_000),
        step=10,
        label="Start, height",
        doc="Height above the ellipsoid at the start, if the file has no heights.",
    )
    rate = Quantity(
        0.0,
        unit="Hz",
        bounds=(0, 1000),
        softbounds=(0, 200),
        step=1,
        label="Rate",
        doc="Rate of the mission's samples; 0 for one that suits the recording.",
    )
