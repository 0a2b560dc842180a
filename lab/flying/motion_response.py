"""Motion response: how a vehicle follows commands of attitude and velocity, compiled."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.compiling.compiled_cache import compile_cached

_REACHED = 1e-4
"""What is left of a target that is reached [rad], [rad/s], [m/s]: far below what sensors show."""
_ANGLES = 3
"""The first numbers of the state are angles, the others velocities."""
_APPROACH = 0.5
"""Time constant with which what is left of a target falls [s]."""
_BRAKING = 1.2
"""Square of the rate from which a turn still stops at its target, over acceleration and angle: without lags
it would be 2. A plain choice, as are the times: no vehicle in particular follows so."""
_LAG, _TURN_LAG = 0.1, 0.05
"""Time constants with which rates and accelerations follow, and turn accelerations [s]."""
_RATES, _CHANGE, _ATTITUDE, _VELOCITY = 1, 3, 4, 5
"""Types of commands: rates, changes, attitude to reach, velocity to reach (gnss-ins-sim)."""


@partial(compile_cached, options={"nopython": True, "error_model": "numpy", "nogil": True})
def respond(
    state: FloatArray,
    table: FloatArray,
    steps: NDArray[np.int64],
    limits: FloatArray,
    stepping: tuple[float, int],
    samples: FloatArray,
    ends: FloatArray,
) -> int:
    """Fill the samples with the response to the commands; return how many there are.

    Angles follow a rate that lets them stop at their target, the rate follows with a limited acceleration
    that lags by 0.05 s; velocities follow with a limited acceleration that lags by 0.1 s.

    Parameters
    ----------
    state : (6,) array
        Yaw, pitch, roll [rad] and body velocity [m/s] at the start; changed.
    table : (k, 7) array
        Type and six numbers of each command [rad, m/s].
    steps : (k,) array
        Longest time of each command, in steps.
    limits : (3,) array
        Acceleration [m/s²], turn acceleration [rad/s²], turn rate [rad/s].
    stepping
        Length of a step [s], steps per sample.
    samples : (n, 6) array
        Filled with the state at the samples.
    ends : (k,) array
        Filled with the step at which each command ended.
    """
    step, per_sample = stepping
    acceleration, turn_acceleration, turn_rate = limits
    first, second = np.zeros(6), np.zeros(6)  # derivatives of the state
    target = np.zeros(6)
    done, count = 0, 0
    for row in range(len(table)):
        kind = int(table[row, 0])
        for i in range(6):
            is_relative = (kind == _ATTITUDE and i >= _ANGLES) or (kind == _VELOCITY and i < _ANGLES)
            change = kind == _CHANGE or is_relative
            target[i] = table[row, i + 1] + (state[i] if change else 0.0)
        for _ in range(steps[row]):
            if done % per_sample == 0:
                samples[count] = state
                count += 1
            done += 1
            reached = kind != _RATES
            for i in range(6):
                left = target[i] - state[i]
                if i < _ANGLES:
                    rate = target[i]
                    if kind != _RATES:
                        braking = math.sqrt(_BRAKING * turn_acceleration * abs(left))
                        rate = math.copysign(min(abs(left) / _APPROACH, braking, turn_rate), left)
                        reached = reached and abs(left) < _REACHED and abs(first[i]) < _REACHED
                    wanted = min(max((rate - first[i]) / _LAG, -turn_acceleration), turn_acceleration)
                    second[i] += (wanted - second[i]) * step / _TURN_LAG
                    state[i] += first[i] * step + 0.5 * second[i] * step**2
                    first[i] += second[i] * step
                else:
                    wanted = target[i]
                    if kind != _RATES:
                        wanted = min(max(left / _APPROACH, -acceleration), acceleration)
                        reached = reached and abs(left) < _REACHED
                    state[i] += first[i] * step
                    first[i] += (wanted - first[i]) * step / _LAG
            if reached:
                break
        ends[row] = done
    if done % per_sample == 0 and count < len(samples):
        samples[count] = state
        count += 1
    return count
