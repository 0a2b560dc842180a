"""Import settings: how a flight is rebuilt from the file of a simulator or logger."""

from __future__ import annotations

import param

from lab.base.parameters.setting_kinds import Quantity
from lab.base.parameters.settings import Settings
from lab.data.rebuild.row_repair import MAX_BRIDGED_GAP
from lab.data.rebuild.time_repair import REPAIRED, TIME_STAMPS
from lab.flying.coordinated_turn import VEHICLES

AUTO = "auto"
MEASURED, ALL = "measured", "all"
"""Which positions of a receiver are used."""
CURVES = ("velocity", "position", "air data")
"""Sources for the reconstruction of a flight."""


class ImportSettings(Settings):
    """Settings of the reconstruction of a flight; the report names the choices made for ``auto``."""

    curve = param.Selector(
        default=AUTO,
        objects=[AUTO, *CURVES],
        label="Curve from",
        doc="Source of the curve. velocity: the recorded velocity, integrated and tied to the positions. "
        "position: a curve through the positions, differentiated. air data: airspeed, angle of attack, "
        "sideslip and attitude, plus the wind. auto: the source with the least noise.",
    )
    time_stamps = param.Selector(
        default=REPAIRED,
        objects=list(TIME_STAMPS),
        label="Time stamps",
        doc="repaired: rounded, repeated or jittery time stamps are re-estimated from the stamps and the "
        "motion, if the motion supports it. as recorded: the stamps are used unchanged.",
    )
    positions = param.Selector(
        default=MEASURED,
        objects=[MEASURED, ALL],
        label="Positions",
        doc="measured: positions that the receiver itself calls estimated (dead reckoning), typed in or "
        "doubtful (a warning, status V) are left out as without a fix. all: they are kept.",
    )
    longest_gap = Quantity(
        2.0,
        unit="s",
        bounds=(0, MAX_BRIDGED_GAP),
        softbounds=(0.5, 30),
        step=0.5,
        label="Longest gap",
        doc="Longest pause between samples that is bridged. The recording is cut at longer pauses, and its "
        "longest stretch is used. Five usual steps are always bridged.",
    )
    smoothing = param.Selector(
        default=AUTO,
        objects=[AUTO, "none", "given"],
        label="Smoothing",
        doc="auto: the amount that predicts left-out samples best, if there is noise. none: the curve "
        "passes through every sample. given: the amount of the smoothing parameter.",
    )
    smoothing_parameter = Quantity(
        0.05,
        unit="s³",
        bounds=(0, 1e6),
        softbounds=(0, 1),
        step=0.01,
        label="Smoothing parameter λ",
        doc="With smoothing = given: weight of the curve's bending against its distance from the samples. "
        "The curve minimises Σ (y − g)² + λ ∫ g''² dt. It smooths the positions, or the velocity for a "
        "curve from velocity.",
    )
    wind = param.Selector(
        default="fitted",
        objects=["fitted", "constant", "none"],
        label="Wind",
        doc="For a curve from air data. fitted: the constant wind with which the flight follows the "
        "recorded positions best; without positions, still air. constant: the given wind. none: still "
        "air.",
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
        doc="Kind of vehicle: determines what is plausible, and the attitude if none is recorded. An "
        "aircraft banks into its turns, a car follows the slope, a boat and a pedestrian stay level, a "
        "copter leans where it accelerates, a rocket points along its path. Copters, rockets and "
        "pedestrians may move in any direction. auto: as stated in the file, otherwise an aircraft.",
    )
    start_latitude = Quantity(
        0.0,
        unit="°",
        bounds=(-90, 90),
        step=0.1,
        label="Start, latitude",
        doc="Latitude of the start, if the file has no positions.",
    )
    start_longitude = Quantity(
        0.0,
        unit="°",
        bounds=(-180, 180),
        step=0.1,
        label="Start, longitude",
        doc="Longitude of the start, if the file has no positions.",
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
        doc="Rate of the mission's samples; 0 chooses a rate that suits the recording.",
    )
