"""Cessna: the aeroplane a pilot flies: instruments to read, controls to move, flown by JSBSim."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Any

from lab.missions.errors import MissionError
from lab.missions.flight_plan import Air, FlightPlan

STEP_MS = 1
"""Integration step [ms]; divides 5, 10 and 55 ms."""
SETTLING_MS = 15_000
"""Time on the wheels, brakes set and engine idling, before the record begins [ms]."""

_FOOT = 0.3048


@dataclass(slots=True)
class Controls:
    """Positions of the pilot's controls, normalised to ±1 (0 to 1 for throttle and brakes).

    Positive: aileron rolls right, elevator pushes the nose down, rudder yaws right, steering turns right.
    """

    aileron: float = 0.0
    elevator: float = 0.0
    rudder: float = 0.0
    steering: float = 0.0
    throttle: float = 0.0
    brakes: float = 1.0


@dataclass(slots=True)
class Instruments:
    """What the pilot sees, SI and radians.

    Attributes
    ----------
    airspeed : float
        True airspeed [m/s].
    height : float
        Height of the wheels above the runway [m], up to a constant of the gear's compression.
    climb_rate : float
        Rate of climb [m/s].
    roll, pitch, heading : float
        Attitude [rad]; heading true, 0 to 2π.
    roll_rate, pitch_rate, yaw_rate : float
        Body rates over the Earth [rad/s].
    alpha, beta : float
        Angle of attack, sideslip [rad].
    on_ground : bool
        A main wheel carries weight.
    """

    airspeed: float
    height: float
    climb_rate: float
    roll: float
    pitch: float
    heading: float
    roll_rate: float
    pitch_rate: float
    yaw_rate: float
    alpha: float
    beta: float
    on_ground: bool


class Cessna:
    """A Cessna 172P standing on a runway with its engine idling.

    Parameters
    ----------
    plan : FlightPlan
        Gives the runway, the air and the seed of its turbulence.

    Raises
    ------
    MissionError
        If JSBSim is not installed or refuses the aircraft.
    """

    def __init__(self, plan: FlightPlan) -> None:
        self._fdm = _executive(plan.aircraft)
        runway, fdm = plan.runway, self._fdm
        fdm["ic/lat-geod-deg"] = runway.latitude_deg
        fdm["ic/long-gc-deg"] = runway.longitude_deg
        fdm["ic/terrain-elevation-ft"] = runway.height_m / _FOOT
        fdm["ic/h-agl-ft"] = 4.36
        fdm["ic/psi-true-deg"] = runway.heading_deg
        fdm["simulation/randomseed"] = plan.seed
        if not fdm.run_ic():
            raise MissionError("JSBSim could not place the aircraft on the runway")
        fdm["simulation/integrator/position/rotational"] = 8
        fdm["propulsion/set-running"] = -1
        self._ground = runway.height_m
        self._standing_height = 0.0
        self.move(Controls())
        _set_wind(fdm, plan.air)
        for _ in range(SETTLING_MS // STEP_MS):
            fdm.run()
        self._standing_height = fdm["position/geod-alt-ft"] * _FOOT - self._ground
        _set_turbulence(fdm, plan.air)

    def step(self) -> None:
        """Fly on by one step of `STEP_MS`."""
        self._fdm.run()

    def move(self, controls: Controls) -> None:
        """Move the controls."""
        fdm = self._fdm
        fdm["fcs/aileron-cmd-norm"] = controls.aileron
        fdm["fcs/elevator-cmd-norm"] = controls.elevator
        # JSBSim's rudder command is positive nose left.
        fdm["fcs/rudder-cmd-norm"] = -controls.rudder
        fdm["fcs/steer-cmd-norm"] = controls.steering
        fdm["fcs/throttle-cmd-norm"] = controls.throttle
        fdm["fcs/left-brake-cmd-norm"] = controls.brakes
        fdm["fcs/right-brake-cmd-norm"] = controls.brakes

    def instruments(self) -> Instruments:
        """Read the instruments."""
        fdm = self._fdm
        return Instruments(
            airspeed=fdm["velocities/vt-fps"] * _FOOT,
            height=fdm["position/geod-alt-ft"] * _FOOT - self._ground - self._standing_height,
            climb_rate=-fdm["velocities/v-down-fps"] * _FOOT,
            roll=fdm["attitude/phi-rad"],
            pitch=fdm["attitude/theta-rad"],
            heading=fdm["attitude/psi-rad"],
            roll_rate=fdm["velocities/p-rad_sec"],
            pitch_rate=fdm["velocities/q-rad_sec"],
            yaw_rate=fdm["velocities/r-rad_sec"],
            alpha=fdm["aero/alpha-rad"],
            beta=fdm["aero/beta-rad"],
            on_ground=bool(fdm["gear/unit[1]/WOW"] or fdm["gear/unit[2]/WOW"]),
        )

    def sample(self) -> tuple[float, ...]:
        """Return what a flight record holds: position, velocity over the Earth, attitude and air data.

        Returns
        -------
        tuple of 12 floats
            Latitude, longitude [rad], height above the ellipsoid [m], north, east, down velocity of the same
            point (the centre of gravity) [m/s], roll, pitch, yaw [rad], true airspeed [m/s], alpha, beta
            [rad].
        """
        fdm = self._fdm
        return (
            fdm["position/lat-geod-rad"],
            fdm["position/long-gc-rad"],
            fdm["position/geod-alt-ft"] * _FOOT,
            fdm["velocities/v-north-fps"] * _FOOT,
            fdm["velocities/v-east-fps"] * _FOOT,
            fdm["velocities/v-down-fps"] * _FOOT,
            fdm["attitude/phi-rad"],
            fdm["attitude/theta-rad"],
            fdm["attitude/psi-rad"],
            fdm["velocities/vt-fps"] * _FOOT,
            fdm["aero/alpha-rad"],
            fdm["aero/beta-rad"],
        )


def _executive(aircraft: str) -> Any:
    # JSBSim looks here when it starts; without it a banner goes to standard output, the caller's.
    os.environ.setdefault("JSBSIM_DEBUG", "0")
    try:
        import jsbsim  # noqa: PLC0415
    except ImportError as error:
        raise MissionError(
            "Flying needs JSBSim, which is not installed: pip install 'ins-lab[fly]'"
        ) from error
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.set_dt(STEP_MS / 1000)
    if not fdm.load_model(aircraft):
        raise MissionError(f"JSBSim could not load the aircraft {aircraft}")
    fdm.disable_output()
    return fdm


def _set_wind(fdm: Any, air: Air) -> None:
    # JSBSim forgets a wind set before run_ic().
    direction = math.radians(air.wind_from_deg)
    fdm["atmosphere/wind-north-fps"] = -air.wind_m_s * math.cos(direction) / _FOOT
    fdm["atmosphere/wind-east-fps"] = -air.wind_m_s * math.sin(direction) / _FOOT


def _set_turbulence(fdm: Any, air: Air) -> None:
    if air.turbulence_severity:
        fdm["atmosphere/turb-type"] = 4
        fdm["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = air.turbulence_wind_m_s / _FOOT
        fdm["atmosphere/turbulence/milspec/severity"] = air.turbulence_severity
