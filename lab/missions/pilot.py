"""Pilot: flies the manoeuvres of a plan by moving the controls, one loop inside the other.

Heading → bank → aileron; height → rate of climb → pitch → elevator; airspeed → throttle; sideslip and yaw
rate → rudder; on the runway heading → nose wheel. After B. L. Stevens and F. L. Lewis, *Aircraft Control and
Simulation*, ch. 4.
"""

from __future__ import annotations

import math

from lab.missions.cessna import Controls, Instruments
from lab.missions.flight_plan import ChangeHeight, FlightPlan, Hold, Manoeuvre, TakeOff, Turn

_NAMES = {TakeOff: "take_off", ChangeHeight: "climb or descend", Turn: "turn", Hold: "hold"}
_GRAVITY = 9.81
_CLIMB_OUT_AIRSPEED = 38.0
_CLIMB_OUT_RATE = 3.3
_CLIMB_OUT_PITCH = math.radians(8.0)
_LOWEST_AIRSPEED = 32.0
_PITCH_RATE_AT_ROTATION = math.radians(3.0)
_BANK_RATE = math.radians(8.0)
_CLIMB_ACCELERATION = 0.5


class Pilot:
    """Flies a plan's manoeuvres one after the other.

    Parameters
    ----------
    plan : FlightPlan
        What to fly.
    period : float
        Time between two looks at the instruments [s].
    """

    def __init__(self, plan: FlightPlan, period: float) -> None:
        self._manoeuvres = plan.manoeuvres
        self._period = period
        self._number = -1
        self._begun_at = 0.0
        self._flying = False
        self._controls = Controls()
        self._heading = math.radians(plan.runway.heading_deg)
        self._turn_left = 0.0
        self._last_heading = self._heading
        self._bank_limit = math.radians(20.0)
        self._bank = 0.0
        self._height = 0.0
        self._rate_limit = _CLIMB_OUT_RATE
        self._rate = 0.0
        self._airspeed = _CLIMB_OUT_AIRSPEED
        self._pitch = 0.0
        self._pitch_trim = 0.0
        self._elevator_trim = 0.0
        self._aileron_trim = 0.0
        self._throttle_trim = 0.6

    @property
    def manoeuvre(self) -> str:
        """The manoeuvre being flown, for messages: its number and name."""
        name = _NAMES[type(self._manoeuvres[self._number])]
        return f"{self._number + 1} of {len(self._manoeuvres)} ({name})"

    @property
    def airborne(self) -> bool:
        """True once the nose was raised for take-off and the wheels left the ground."""
        return self._flying

    @property
    def on_last_manoeuvre(self) -> bool:
        """True once the last manoeuvre of the plan is being flown."""
        return self._number == len(self._manoeuvres) - 1

    def fly(self, time: float, seen: Instruments) -> Controls:
        """Return the controls for what the instruments show.

        Parameters
        ----------
        time : float
            Time since the start [s].
        seen : Instruments
            What the instruments show.
        """
        if self._number < 0 or (
            not self.on_last_manoeuvre and self._done(self._manoeuvres[self._number], time, seen)
        ):
            self._number += 1
            self._begun_at = time
            self._begin(self._manoeuvres[self._number], seen)
        self._track_heading(seen)
        manoeuvre = self._manoeuvres[self._number]
        if isinstance(manoeuvre, TakeOff) and not self._flying:
            self._roll_down_the_runway(manoeuvre, time, seen)
        else:
            self._hold_bank(seen)
            self._hold_climb(seen)
            self._hold_airspeed(seen)
        self._hold_pitch(seen)
        return self._controls

    def _begin(self, manoeuvre: Manoeuvre, seen: Instruments) -> None:
        if isinstance(manoeuvre, TakeOff):
            # The climb goes on through the end of the take-off, whatever follows.
            self._height, self._pitch = manoeuvre.height_m + 60.0, seen.pitch
        elif isinstance(manoeuvre, ChangeHeight):
            self._height, self._rate_limit = manoeuvre.height_m, manoeuvre.rate_m_s
            self._airspeed = manoeuvre.airspeed_m_s
        elif isinstance(manoeuvre, Turn):
            self._heading = math.radians(manoeuvre.heading_deg)
            self._bank_limit = math.radians(manoeuvre.bank_deg)
            self._turn_left = _angle(self._heading - seen.heading)
            if manoeuvre.direction == "right" and self._turn_left < 0:
                self._turn_left += math.tau
            elif manoeuvre.direction == "left" and self._turn_left > 0:
                self._turn_left -= math.tau

    def _done(self, manoeuvre: Manoeuvre, time: float, seen: Instruments) -> bool:
        elapsed = time - self._begun_at
        match manoeuvre:
            case TakeOff():
                return self._flying and seen.height >= manoeuvre.height_m
            case ChangeHeight():
                return elapsed >= manoeuvre.seconds or abs(seen.height - manoeuvre.height_m) < 5.0
            case Turn():
                return abs(self._turn_left) < math.radians(2.0) and abs(seen.roll) < math.radians(3.0)
            case Hold():
                return elapsed >= manoeuvre.seconds

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
        if seen.airspeed >= take_off.rotation_m_s:
            self._pitch = min(self._pitch + _PITCH_RATE_AT_ROTATION * self._period, _CLIMB_OUT_PITCH)
        if seen.height > 3.0 and not seen.on_ground:
            self._flying = True
            self._controls.steering = 0.0
            self._rate = max(seen.climb_rate, 0.0)
            self._pitch_trim = self._pitch - self._rate / seen.airspeed

    def _hold_bank(self, seen: Instruments) -> None:
        wanted = _clip(1.2 * self._turn_left, -self._bank_limit, self._bank_limit)
        change = _BANK_RATE * self._period
        change = _clip(wanted - self._bank, -change, change)
        self._bank += change
        error = self._bank - seen.roll
        self._aileron_trim = _clip(self._aileron_trim + 0.25 * error * self._period, -0.2, 0.2)
        aileron = self._aileron_trim + 2.0 * error + 0.5 * (change / self._period - seen.roll_rate)
        self._move("aileron", _clip(aileron, -0.8, 0.8), lag=0.1)
        turn_rate = _GRAVITY * math.tan(seen.roll) / max(seen.airspeed, 20.0) * math.cos(seen.roll)
        rudder = 1.0 * seen.beta - 0.6 * (seen.yaw_rate - turn_rate)
        self._move("rudder", _clip(rudder, -0.6, 0.6), lag=0.2)

    def _hold_climb(self, seen: Instruments) -> None:
        wanted = _clip(0.2 * (self._height - seen.height), -self._rate_limit, self._rate_limit)
        change = _CLIMB_ACCELERATION * self._period
        self._rate += _clip(wanted - self._rate, -change, change)
        airspeed = max(seen.airspeed, 20.0)
        error = (self._rate - seen.climb_rate) / airspeed
        slow = max(_LOWEST_AIRSPEED - seen.airspeed, 0.0)
        self._pitch_trim = _clip(self._pitch_trim + (0.25 * error - 0.02 * slow) * self._period, -0.15, 0.2)
        pitch = self._rate / airspeed + self._pitch_trim + 0.5 * error
        self._pitch = _clip(pitch, math.radians(-10), math.radians(14))

    def _hold_pitch(self, seen: Instruments) -> None:
        error = self._pitch - seen.pitch
        pitch_rate = seen.pitch_rate * math.cos(seen.roll) - seen.yaw_rate * math.sin(seen.roll)
        if self._flying:
            self._elevator_trim = _clip(self._elevator_trim - 0.8 * error * self._period, -0.6, 0.6)
        elevator = self._elevator_trim - 2.0 * error + 0.8 * pitch_rate
        self._move("elevator", _clip(elevator, -1, 1), lag=0.1)

    def _hold_airspeed(self, seen: Instruments) -> None:
        error = self._airspeed - seen.airspeed
        self._throttle_trim = _clip(self._throttle_trim + 0.005 * error * self._period, 0.0, 1.0)
        throttle = self._throttle_trim + 0.1 * error + 0.1 * self._rate
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
