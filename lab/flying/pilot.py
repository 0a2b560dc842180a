"""Pilot: flies the manoeuvres of a plan by moving the controls, one loop inside the other.

Heading → bank → aileron; height → rate of climb → pitch → elevator; airspeed → throttle; sideslip and yaw
rate → rudder; on the runway heading → nose wheel. After B. L. Stevens and F. L. Lewis, *Aircraft Control and
Simulation*, ch. 4.
"""

from __future__ import annotations

import math

from lab.flying.flight_plan import FlightPlan
from lab.flying.manoeuvres import (
    WORDS,
    ChangeHeight,
    ChangeSpeed,
    Hold,
    Level,
    Manoeuvre,
    TakeOff,
    Turn,
    TurnBy,
    split_turns,
)
from lab.flying.simulated_aircraft import Controls, Instruments

_GRAVITY = 9.81
"""Gravity as a pilot knows it [m/s²]; every flight's bits depend on it."""
_PITCH_RATE_AT_ROTATION = math.radians(3.0)
"""Rate at which the nose is raised for take-off [rad/s]: the usual rate of airliners."""
_BANK_RATE = math.radians(8.0)
"""Rate at which the pilot rolls into a turn and out of it [rad/s]: a calm one."""
_SKID_RATE = math.radians(2.0)
"""Rate at which a sideslip is built up [rad/s]: slow enough for the rudder to hold it."""

PATIENCE = 60.0
"""Time without progress of a manoeuvre after which it cannot be done [s]."""
_RUN_UP = 60.0
"""Airspeed up to which speeding up is progress of a take-off [m/s]: on the runway, the height does not
change. From there on, the fastest aircraft, which rotates at 80 m/s, has to gain height within `PATIENCE`."""
_HEIGHT_PROGRESS, _SPEED_PROGRESS, _TURN_PROGRESS = 3.0, 0.5, 2.0
"""Least change within `PATIENCE` that is progress [m], [m/s], [°]. The slowest climb of a plan makes 12 m of
it, the flattest turn of the fastest aircraft 12°. Less than this left is as good as done."""
_RUN_UP_PROGRESS = 1.0
"""Least change within `PATIENCE` that is progress of a take-off, of airspeed [m/s] and height [m] together: a
Cessna 172 gains 2 m/s each second."""
_HEIGHT_REACHED = 5.0
"""Distance from a height at which a climb ends [m]: the pilot approaches it with a time constant of 5 s, so
the last metres to 1 m would take 8 s more."""
_RATE_LEVEL = 0.3
"""Rate of climb below which an aircraft is level [m/s]: it is taken off within 0.6 s and makes 0.1 m of
height."""
_SPEED_REACHED = 1.0
"""Distance from an airspeed at which a change of it ends [m/s]. A plain choice: the airspeed is approached
ever more slowly, and what is left does not matter to the next manoeuvre."""
_HEADING_REACHED, _WINGS_LEVEL = math.radians(2.0), math.radians(3.0)
"""Angle left, and bank, at which a turn ends [rad]: for the last 2°, the default gain banks by 2.4°."""
_LIFTED = 3.0
"""Height above that at a stand from which the aircraft flies [m]. A plain choice: lower, it may touch down
again, and its undercarriage is raised here."""
_SLOWEST = 20.0
"""Least airspeed by which rates are divided [m/s]: below the stall of all aircraft but the slowest, so that
gains stay finite."""


class Pilot:
    """Flies a plan's manoeuvres one after the other.

    Parameters
    ----------
    plan : FlightPlan
        The plan.
    period : float
        Time between two looks at the instruments [s].
    controls : Controls
        Where the controls are at the start.

    Attributes
    ----------
    aircraft : Aircraft
        The aircraft as the pilot knows it.
    airborne : bool
        True once the nose was raised for take-off and the wheels left the ground.
    """

    def __init__(self, plan: FlightPlan, period: float, controls: Controls) -> None:
        aircraft = plan.flown_with
        self.aircraft, self._gains = aircraft, aircraft.gains
        self._plan = plan
        self._steps = [
            (number, step) for number, one in enumerate(plan.manoeuvres, 1) for step in split_turns(one)
        ]
        self._period = period
        self._number = -1
        self._finished = False
        self._begun_at = 0.0
        self._nearest, self._nearest_at = math.inf, 0.0
        self._controls = controls
        start = plan.air_start or plan.runway
        assert start is not None
        self._heading = math.radians(start.heading_deg)
        self._turn_left = 0.0
        self._last_heading = self._heading
        self._bank_limit = math.radians(20.0)
        self._bank = 0.0
        self._skid, self._wanted_skid, self._skid_trim = 0.0, 0.0, 0.0
        self._height = 0.0
        self._rate_limit = aircraft.rate
        self._rate = 0.0
        self._airspeed = aircraft.climb_out
        self._pitch = 0.0
        self._pitch_trim = 0.0
        self._elevator_trim = 0.0
        self._aileron_trim = 0.0
        self._throttle_trim = 0.6
        self.airborne = plan.air_start is not None

    @property
    def manoeuvre(self) -> str:
        """The manoeuvre being flown, for messages: its number and name."""
        number = self._steps[self._number][0]
        manoeuvres = self._plan.manoeuvres
        return f"{number} of {len(manoeuvres)} ({WORDS[type(manoeuvres[number - 1])]})"

    @property
    def on_last_manoeuvre(self) -> bool:
        """True once the last manoeuvre of the plan is being flown, or the last part of it."""
        return self._number == len(self._steps) - 1

    def fly(self, time: float, seen: Instruments) -> Controls:
        """Return the controls for the readings of the instruments.

        Parameters
        ----------
        time : float
            Time since the start [s].
        seen : Instruments
            What the instruments show.
        """
        if self._number < 0:
            self._take_over(seen)
        done = self._number >= 0 and self._is_done(self._step, time, seen)
        self._finished = self._finished or (done and self.on_last_manoeuvre)
        if self._number < 0 or (done and not self.on_last_manoeuvre):
            self._number += 1
            self._begun_at = time
            self._nearest, self._nearest_at = math.inf, time
            self._begin(self._step, seen)
        self._track_heading(seen)
        step = self._step
        if isinstance(step, TakeOff) and not self.airborne:
            self._roll_down_the_runway(step, time, seen)
        else:
            self._hold_bank(seen)
            self._hold_climb(seen)
            self._hold_airspeed(seen)
        self._hold_pitch(seen)
        return self._controls

    def find_missed_target(self, time: float, seen: Instruments) -> str:
        """Return the target that the manoeuvre has not come closer to for `PATIENCE`, or nothing.

        Parameters
        ----------
        time : float
            Time since the start [s].
        seen : Instruments
            What the instruments show.
        """
        if self._finished or self._number < 0:
            return ""
        left, enough, what = self._remaining_amount(time, seen)
        if left < self._nearest - enough:
            self._nearest, self._nearest_at = left, time
        return what if time - self._nearest_at > PATIENCE and left > enough else ""

    def _remaining_amount(self, time: float, seen: Instruments) -> tuple[float, float, str]:
        """Return the remaining amount, the least decrease that counts, and words for it."""
        match self._step:
            case TakeOff() as take_off:
                if time - self._begun_at < take_off.wait_s:
                    self._nearest_at = time
                left = take_off.height_m - seen.height + _RUN_UP - min(seen.airspeed, _RUN_UP)
                return left, _RUN_UP_PROGRESS, f"airspeed {seen.airspeed:.1f} m/s, height {seen.height:.0f} m"
            case ChangeHeight() as change:
                asked = f"height {seen.height:.0f} m of {change.height_m:g} m"
                return abs(seen.height - change.height_m), _HEIGHT_PROGRESS, asked
            case ChangeSpeed() as change:
                asked = f"airspeed {seen.airspeed:.1f} m/s of {change.airspeed_m_s:g} m/s"
                return abs(seen.airspeed - change.airspeed_m_s), _SPEED_PROGRESS, asked
            case Turn() | TurnBy():
                left = math.degrees(abs(self._turn_left))
                return left, _TURN_PROGRESS, f"{left:.0f}° left to turn"
            case _:
                return 0.0, 1.0, ""

    @property
    def _step(self) -> Manoeuvre:
        return self._steps[self._number][1]

    def _take_over(self, seen: Instruments) -> None:
        """Fly on as trimmed, where the flight starts in the air."""
        if self.airborne:
            self._height, self._airspeed = seen.height, seen.airspeed
            self._pitch = self._pitch_trim = seen.pitch
            self._throttle_trim = self._controls.throttle

    def _begin(self, step: Manoeuvre, seen: Instruments) -> None:
        self._wanted_skid = 0.0
        match step:
            case TakeOff():
                # The climb goes on through the end of the take-off, whatever follows.
                self._height, self._pitch = step.height_m + 60.0, seen.pitch
            case ChangeHeight():
                self._height = step.height_m
                self._rate_limit = self.aircraft.rate if step.rate_m_s is None else step.rate_m_s
                self._airspeed = self.aircraft.airspeed if step.airspeed_m_s is None else step.airspeed_m_s
            case Level():
                # How far it goes on while the rate is taken off, up or down.
                stopping = self._rate * abs(self._rate) / (2 * self.aircraft.climb_acceleration)
                self._height = seen.height + stopping
            case ChangeSpeed():
                self._airspeed = step.airspeed_m_s
            case Turn():
                self._turn(_angle(math.radians(step.heading_deg) - seen.heading), step)
                if step.direction == "right" and self._turn_left < 0:
                    self._turn_left += math.tau
                elif step.direction == "left" and self._turn_left > 0:
                    self._turn_left -= math.tau
            case TurnBy():
                # Relative to the last commanded heading, so that the errors of turns do not add up.
                angle = math.radians(step.angle_deg if step.direction == "right" else -step.angle_deg)
                self._turn(self._turn_left + angle, step)

    def _turn(self, angle: float, step: Turn | TurnBy) -> None:
        self._turn_left = angle
        self._bank_limit = math.radians(step.bank_deg)
        # In a skid to the right the air comes from the left.
        self._wanted_skid = -math.copysign(math.radians(step.skid_deg), angle)

    def _is_done(self, step: Manoeuvre, time: float, seen: Instruments) -> bool:
        elapsed = time - self._begun_at
        match step:
            case TakeOff():
                done = self.airborne and seen.height >= step.height_m
            case ChangeHeight():
                done = elapsed >= step.seconds or abs(seen.height - step.height_m) < _HEIGHT_REACHED
            case Level():
                done = abs(seen.climb_rate) < _RATE_LEVEL and abs(self._rate) < _RATE_LEVEL
            case ChangeSpeed():
                done = abs(seen.airspeed - step.airspeed_m_s) < _SPEED_REACHED
            case Hold():
                done = elapsed >= step.seconds
            case _:
                done = abs(self._turn_left) < _HEADING_REACHED and abs(seen.roll) < _WINGS_LEVEL
        return done

    def _track_heading(self, seen: Instruments) -> None:
        """Count down the turn left to fly; unwrapped, so that a turn may exceed 180°."""
        self._turn_left -= _angle(seen.heading - self._last_heading)
        self._last_heading = seen.heading

    def _roll_down_the_runway(self, take_off: TakeOff, time: float, seen: Instruments) -> None:
        rolling = time - take_off.wait_s
        controls = self._controls
        controls.brakes = _clip(1.0 - rolling / 1.5, 0.0, 1.0)
        controls.throttle = _clip(rolling / 4.0, 0.0, 1.0)
        error = _angle(self._heading - seen.heading)
        # The nose wheel does less and the rudder more as the speed grows.
        wheel = 1.0 / (1.0 + (seen.airspeed / 8.0) ** 2)
        self._move("steering", _clip(wheel * (8.0 * error - 3.0 * seen.yaw_rate), -1, 1), lag=0.15)
        self._move("rudder", _clip(2.0 * error - 1.0 * seen.yaw_rate, -1, 1), lag=0.15)
        self._move("aileron", _clip(-1.5 * seen.roll - 0.5 * seen.roll_rate, -0.5, 0.5), lag=0.15)
        rotation = self.aircraft.rotation if take_off.rotation_m_s is None else take_off.rotation_m_s
        assert rotation is not None  # a plan with a take-off has an aircraft that takes off
        if seen.airspeed >= rotation:
            self._pitch = min(
                self._pitch + _PITCH_RATE_AT_ROTATION * self._period, self.aircraft.climb_out_pitch
            )
        if seen.height > _LIFTED and not seen.on_ground:
            self.airborne = True
            self._controls.steering = 0.0
            self._controls.gear_down = False
            self._rate = max(seen.climb_rate, 0.0)
            self._pitch_trim = self._pitch - self._rate / seen.airspeed

    def _hold_bank(self, seen: Instruments) -> None:
        wanted = _clip(self._gains.heading * self._turn_left, -self._bank_limit, self._bank_limit)
        change = _BANK_RATE * self._period
        change = _clip(wanted - self._bank, -change, change)
        self._bank += change
        error = self._bank - seen.roll
        most = 0.2 / self._gains.aileron
        self._aileron_trim = _clip(self._aileron_trim + 0.25 * error * self._period, -most, most)
        aileron = self._aileron_trim + 2.0 * error + 0.5 * (change / self._period - seen.roll_rate)
        self._move("aileron", _clip(self._gains.aileron * aileron, -0.8, 0.8), lag=0.1)
        # g tan φ / V about the vertical, of which the yaw axis of the body has cos φ.
        turn_rate = _GRAVITY * math.tan(seen.roll) / max(seen.airspeed, _SLOWEST) * math.cos(seen.roll)
        rudder = (
            self._skid_trim + 1.0 * (seen.beta - self._hold_skid(seen)) - 0.6 * (seen.yaw_rate - turn_rate)
        )
        self._move("rudder", _clip(self._gains.rudder * rudder, -0.6, 0.6), lag=0.2)

    def _hold_skid(self, seen: Instruments) -> float:
        """Return the sideslip to hold: zero but in a skidding or slipping turn."""
        change = _SKID_RATE * self._period
        # Let off as the wings are levelled.
        wanted = self._wanted_skid * min(abs(self._gains.heading * self._turn_left) / self._bank_limit, 1.0)
        self._skid += _clip(wanted - self._skid, -change, change)
        if self._skid:
            trim = self._skid_trim + 1.0 * (seen.beta - self._skid) * self._period
            self._skid_trim = _clip(trim, -0.5, 0.5)
        else:
            self._skid_trim -= _clip(self._skid_trim, -0.1 * self._period, 0.1 * self._period)
        return self._skid

    def _hold_climb(self, seen: Instruments) -> None:
        above, acceleration = self._height - seen.height, self.aircraft.climb_acceleration
        # As far from the height as the rate can still be taken off at most of the acceleration.
        stopping = math.sqrt(1.6 * acceleration * abs(above))
        wanted = _clip(0.2 * above, -stopping, stopping)
        wanted = _clip(wanted, -self._rate_limit, self._rate_limit)
        change = acceleration * self._period
        self._rate += _clip(wanted - self._rate, -change, change)
        airspeed = max(seen.airspeed, _SLOWEST)
        error = (self._rate - seen.climb_rate) / airspeed
        slow = max(self.aircraft.slowest - seen.airspeed, 0.0)
        self._pitch_trim = _clip(self._pitch_trim + (0.25 * error - 0.02 * slow) * self._period, -0.15, 0.2)
        pitch = self._rate / airspeed + self._pitch_trim + 0.5 * error
        self._pitch = _clip(pitch, math.radians(-10), math.radians(14))

    def _hold_pitch(self, seen: Instruments) -> None:
        error = self._pitch - seen.pitch
        # The rate of the pitch angle, which in a bank is not that about the lateral axis.
        pitch_rate = seen.pitch_rate * math.cos(seen.roll) - seen.yaw_rate * math.sin(seen.roll)
        if self.airborne:
            self._elevator_trim = _clip(self._elevator_trim - 0.8 * error * self._period, -0.6, 0.6)
        elevator = self._elevator_trim - 2.0 * error + 0.8 * pitch_rate
        self._move("elevator", _clip(self._gains.elevator * elevator, -1, 1), lag=0.1)

    def _hold_airspeed(self, seen: Instruments) -> None:
        gains, error = self._gains, self._airspeed - seen.airspeed
        trim = self._throttle_trim + gains.throttle_trim * error * self._period
        self._throttle_trim = _clip(trim, 0.0, 1.0)
        throttle = self._throttle_trim + gains.throttle_speed * error + gains.throttle_climb * self._rate
        self._controls.brakes = 0.0
        self._move("throttle", _clip(throttle, 0.0, 1.0), lag=1.0)

    def _move(self, control: str, wanted: float, lag: float) -> None:
        """Move a control towards a position with a hand's first-order lag [s]."""
        now = getattr(self._controls, control)
        setattr(self._controls, control, now + (wanted - now) * self._period / lag)


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _angle(value: float) -> float:
    """Return an angle within ±π."""
    return math.remainder(value, math.tau)
