"""SimulatedAircraft: an aircraft simulated by JSBSim, with instruments to read and controls to move."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import FOOT, RANKINES_PER_KELVIN
from lab.flying.flight_plan import AirStart, FlightPlan, Runway
from lab.flying.weather import Air

STEP_MS = 1
"""Integration step [ms]; divides 5, 10 and 55 ms."""
SETTLING_MS = 15_000
"""Time on the wheels, brakes set and engine idling, before the record begins [ms]."""

_LONGITUDINAL = 0
"""JSBSim's number of the trim of speed, height and pitch."""
_AXES = ("north", "east", "down")
_STILL = ((), (), ())


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
    gear_down: bool = True


@dataclass(slots=True)
class Instruments:
    """The instruments' values, in SI units and radians.

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


class SimulatedAircraft:
    """An aircraft at the start of a plan: on the runway with its engine idling, or trimmed in the air.

    Parameters
    ----------
    plan : FlightPlan
        Gives the aircraft, the start, the air and the seed of its turbulence.

    Raises
    ------
    MissionError
        If JSBSim is not installed, refuses the aircraft or cannot trim it.
    """

    def __init__(self, plan: FlightPlan) -> None:
        self._aircraft = plan.flown_with
        self._fdm = _executive(plan.aircraft)
        self._fdm["simulation/randomseed"] = plan.seed
        if plan.air.temperature_deviation_k:
            self._fdm["atmosphere/delta-T"] = plan.air.temperature_deviation_k * RANKINES_PER_KELVIN
        self.trimmed = Controls()
        self._standing_height = 0.0
        self._gusts = plan.air.gusts
        self._time_ms = 0
        if plan.air_start is None:
            assert plan.runway is not None
            self._stand_on_runway(plan.runway, plan.air)
        else:
            self._trim(plan.air_start, plan.air)
        _set_turbulence(self._fdm, plan.air)

    def _stand_on_runway(self, runway: Runway, air: Air) -> None:
        fdm = self._fdm
        fdm["ic/lat-geod-deg"] = runway.latitude_deg
        fdm["ic/long-gc-deg"] = runway.longitude_deg
        fdm["ic/terrain-elevation-ft"] = runway.height_m / FOOT
        fdm["ic/h-agl-ft"] = self._aircraft.standing_height_ft
        fdm["ic/psi-true-deg"] = runway.heading_deg
        self._begin(runway.height_m)
        self.move(Controls())
        _set_wind(fdm, air)
        for _ in range(SETTLING_MS // STEP_MS):
            fdm.run()
        self._standing_height = fdm["position/geod-alt-ft"] * FOOT - self._ground

    def _trim(self, start: AirStart, air: Air) -> None:
        fdm = self._fdm
        airspeed = self._aircraft.airspeed if start.airspeed_m_s is None else start.airspeed_m_s
        fdm["ic/lat-geod-deg"] = start.latitude_deg
        fdm["ic/long-gc-deg"] = start.longitude_deg
        fdm["ic/terrain-elevation-ft"] = start.ground_m / FOOT
        fdm["ic/h-agl-ft"] = start.height_m / FOOT
        # In this order, because each of these changes the ones set before it, except for the heading, which
        # is set last.
        fdm["ic/psi-true-deg"] = start.heading_deg
        fdm["ic/vw-mag-fps"] = air.wind_m_s / FOOT
        fdm["ic/vw-dir-deg"] = air.wind_from_deg + 180.0
        heading, wind_from = math.radians(start.heading_deg), math.radians(air.wind_from_deg)
        fdm["ic/vn-fps"] = (airspeed * math.cos(heading) - air.wind_m_s * math.cos(wind_from)) / FOOT
        fdm["ic/ve-fps"] = (airspeed * math.sin(heading) - air.wind_m_s * math.sin(wind_from)) / FOOT
        fdm["ic/vd-fps"] = 0.0
        fdm["ic/psi-true-deg"] = start.heading_deg
        self._begin(start.ground_m)
        if self._aircraft.retracts:
            fdm["gear/gear-cmd-norm"] = fdm["gear/gear-pos-norm"] = 0.0
        fdm["fcs/left-brake-cmd-norm"] = fdm["fcs/right-brake-cmd-norm"] = 0.0
        import jsbsim  # noqa: PLC0415 - an extra

        logger = jsbsim.get_logger()
        jsbsim.set_logger(jsbsim.FGLogger())  # not to standard output, the caller's
        try:
            fdm["simulation/do_simple_trim"] = _LONGITUDINAL
        except jsbsim.TrimFailureError as error:
            raise MissionError(
                f"JSBSim cannot trim the {self._aircraft.title} at {airspeed:g} m/s, {start.height_m:g} m "
                "above the ground: change airspeed_m_s or height_m of air_start"
            ) from error
        finally:
            jsbsim.set_logger(logger)
        self.trimmed = Controls(throttle=fdm["fcs/throttle-cmd-norm"], brakes=0.0, gear_down=False)

    def _begin(self, ground: float) -> None:
        fdm = self._fdm
        if not fdm.run_ic():
            raise MissionError("JSBSim could not place the aircraft")
        fdm["simulation/integrator/position/rotational"] = 8
        fdm["propulsion/set-running"] = -1
        self._ground = ground
        self._throttles = _further_throttles(fdm, "fcs/throttle-cmd-norm")

    def step(self) -> None:
        """Fly on by one step of `STEP_MS`."""
        if self._gusts:
            self._set_gusts(self._time_ms / 1000)
            self._time_ms += STEP_MS
        self._fdm.run()

    def _set_gusts(self, time: float) -> None:
        """Set the sum of the gusts; JSBSim adds it to the wind and the turbulence."""
        velocities = [gust.velocity_n(time) for gust in self._gusts if gust.blows(time)]
        for axis, speeds in zip(_AXES, zip(*velocities, strict=True) if velocities else _STILL, strict=True):
            self._fdm[f"atmosphere/gust-{axis}-fps"] = sum(speeds) / FOOT

    def move(self, controls: Controls) -> None:
        """Move the controls."""
        fdm = self._fdm
        fdm["fcs/aileron-cmd-norm"] = controls.aileron
        fdm["fcs/elevator-cmd-norm"] = controls.elevator
        # JSBSim's rudder command is positive nose left.
        fdm["fcs/rudder-cmd-norm"] = -controls.rudder
        fdm["fcs/steer-cmd-norm"] = controls.steering
        fdm["fcs/throttle-cmd-norm"] = controls.throttle
        for throttle in self._throttles:
            fdm[throttle] = controls.throttle
        if self._aircraft.retracts:
            fdm["gear/gear-cmd-norm"] = float(controls.gear_down)
        fdm["fcs/left-brake-cmd-norm"] = controls.brakes
        fdm["fcs/right-brake-cmd-norm"] = controls.brakes

    def instruments(self) -> Instruments:
        """Read the instruments."""
        fdm = self._fdm
        return Instruments(
            airspeed=fdm["velocities/vt-fps"] * FOOT,
            height=fdm["position/geod-alt-ft"] * FOOT - self._ground - self._standing_height,
            climb_rate=-fdm["velocities/v-down-fps"] * FOOT,
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

    def out_of_fuel(self) -> bool:
        """Return whether the engine has stopped, for want of fuel."""
        # Not all fuel is within reach: one of the t6texan2's two tanks feeds nothing.
        return not self._fdm["propulsion/engine/set-running"]

    def sample(self) -> tuple[float, ...]:
        """Return the values of a recording: position, velocity over the Earth, attitude and air data.

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
            fdm["position/geod-alt-ft"] * FOOT,
            fdm["velocities/v-north-fps"] * FOOT,
            fdm["velocities/v-east-fps"] * FOOT,
            fdm["velocities/v-down-fps"] * FOOT,
            fdm["attitude/phi-rad"],
            fdm["attitude/theta-rad"],
            fdm["attitude/psi-rad"],
            fdm["velocities/vt-fps"] * FOOT,
            fdm["aero/alpha-rad"],
            fdm["aero/beta-rad"],
        )


def _executive(aircraft: str) -> Any:
    try:
        import jsbsim  # noqa: PLC0415
    except ImportError as error:
        raise MissionError(
            "Flying needs JSBSim, which is not installed: pip install 'ins-lab[fly]'"
        ) from error
    # Otherwise a banner goes to standard output, the caller's.
    jsbsim.FGJSBBase().debug_lvl = 0  # type: ignore[no-untyped-call]
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.set_dt(STEP_MS / 1000)
    if not fdm.load_model(aircraft):
        raise MissionError(f"JSBSim could not load the aircraft {aircraft}")
    # Some models write files, or open ports to be steered through.
    fdm.disable_output()
    fdm.disable_input()
    return fdm


def _further_throttles(fdm: Any, throttle: str) -> list[str]:
    """Return the throttles of the second engine and further ones."""
    found = fdm.query_property_catalog(throttle).splitlines()
    return [line.split()[0] for line in found if line.startswith(f"{throttle}[")]


def _set_wind(fdm: Any, air: Air) -> None:
    # JSBSim forgets a wind set before run_ic().
    direction = math.radians(air.wind_from_deg)
    fdm["atmosphere/wind-north-fps"] = -air.wind_m_s * math.cos(direction) / FOOT
    fdm["atmosphere/wind-east-fps"] = -air.wind_m_s * math.sin(direction) / FOOT


def _set_turbulence(fdm: Any, air: Air) -> None:
    if air.turbulence_severity:
        fdm["atmosphere/turb-type"] = 4
        fdm["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = air.turbulence_wind_m_s / FOOT
        fdm["atmosphere/turbulence/milspec/severity"] = air.turbulence_severity
