"""Transition: the response of the navigation errors to initial errors and IMU errors over an interval.

The error model is linear: the errors at the end of an interval are a sum of responses to the errors at its
start and to those of every inertial sample in it. The samples are processed backwards, so that each response
is a product with the transition over the later samples.

Errors are resolved in Earth-fixed axes e, where the model is the same at a pole as elsewhere. In a filter's
own frame it is another form of the same (`error_axes`).

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch.
14.2.3 (errors resolved in e).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.navigation.filters.error_models import A, B, G, P, V, gravity_gradient, skew
from lab.navigation.kernels.compilation import entry_kernel, inline_kernel, kernel
from lab.navigation.strapdown import cross, get, gravity, matrix, plus, radii, rotate

N, NAV, BIASES = 15, 9, 6
"""Number of error states, of navigation states among them, and of biases."""


class FlightArrays(NamedTuple):
    """The true flight: n + 1 samples of position, velocity and attitude, and n ideal increments of length dt.

    Attributes
    ----------
    latitude, longitude, height : (n + 1,) arrays
        Position [rad], [rad], [m].
    velocity_n : (n + 1, 3) array
        Velocity north, east, down [m/s].
    q_nb : (n + 1, 4) array
        Attitude, scalar first.
    dtheta, dvelocity : (n, 3) arrays
        Increments of angle [rad] and velocity [m/s], in b.
    dt
        Length of each interval [s].
    """

    latitude: FloatArray
    longitude: FloatArray
    height: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    dtheta: FloatArray
    dvelocity: FloatArray
    dt: float

    def between(self, first: int, last: int) -> FlightArrays:
        """Return the flight from one sample to another, all in float64."""
        samples, increments = slice(first, last + 1), slice(first, last)
        return FlightArrays(
            self.latitude[samples],
            self.longitude[samples],
            self.height[samples],
            self.velocity_n[samples].astype(np.float64, copy=False),
            self.q_nb[samples].astype(np.float64, copy=False),
            self.dtheta[increments].astype(np.float64, copy=False),
            self.dvelocity[increments].astype(np.float64, copy=False),
            self.dt,
        )


class Processes(NamedTuple):
    """First-order random processes c of p triads, as errors of their bias estimates.

    Attributes
    ----------
    channel : (p,) array
        0 for gyros, 1 for accelerometers.
    decay : (p,) array
        Remaining fraction of c in the next sample.
    drive : (p, 3) array
        Added variance in each sample.
    """

    channel: NDArray[np.int64]
    decay: FloatArray
    drive: FloatArray


class Transition(NamedTuple):
    """Responses of the nine navigation errors in e over an interval.

    Attributes
    ----------
    navigation : (9, 9) array
        Response to themselves.
    bias : (9, 6) array
        Response to constant bias errors.
    fading : (9, b) array
        Response to errors that act as those of the biases, and decay as states of the filter do.
    coupled : (9, 6, 6) array
        Response to errors of gyros and accelerometers that are proportional to a component of rate or force.
    process : (p, 9, 3) array
        Response to c, decaying from 1 in the first sample.
    covariance, cross : (p, 9, 9), (p, 9, 3) arrays
        Covariance of the navigation errors due to the noise of c: with themselves, and with c at the end.
    power : (p,) array
        Fraction of c of the first sample that remains after the last.
    driven : (s, 9) array
        Response to known errors of the IMU.
    """

    navigation: FloatArray
    bias: FloatArray
    fading: FloatArray
    coupled: FloatArray
    process: FloatArray
    covariance: FloatArray
    cross: FloatArray
    power: FloatArray
    driven: FloatArray

    @classmethod
    def empty(cls, processes: int, known: int = 0, fading: int = BIASES) -> Transition:
        """Allocate arrays for a number of processes, of known errors and of states that decay."""
        return cls(
            np.zeros((NAV, NAV)),
            np.zeros((NAV, BIASES)),
            np.zeros((NAV, fading)),
            np.zeros((NAV, BIASES, BIASES)),
            np.zeros((processes, NAV, 3)),
            np.zeros((processes, NAV, NAV)),
            np.zeros((processes, NAV, 3)),
            np.ones(processes),
            np.zeros((known, NAV)),
        )


@inline_kernel
def _write(flight: FlightArrays, k: int, F: FloatArray) -> None:
    """Write F of the errors in e, from the truth at sample k (Groves 14.47-14.49, with the sign of ψ here).

        δṙ = δv,   δv̇ = Γ δr − 2 ω_ie × δv + f × ψ − C_eb δb_a,   ψ̇ = −ω_ie × ψ + C_eb δb_g

    with Γ the change of gravity with the position.
    """
    s, c, height = np.sin(flight.latitude[k]), np.cos(flight.latitude[k]), flight.height[k]
    sl, cl = np.sin(flight.longitude[k]), np.cos(flight.longitude[k])
    C_en = (-s * cl, -sl, -c * cl), (-s * sl, cl, -c * sl), (c, 0.0, -s)
    meridian, transverse = radii(s)
    g = gravity(s, height)
    by_latitude, by_height = gravity_gradient(s, c, height)
    north, east = g / (meridian + height), g / (transverse + height)
    slope = by_latitude / (meridian + height)
    q, dvelocity = flight.q_nb[k], get(flight.dvelocity[k], 0)
    C_nb = matrix((q[0], q[1], q[2], q[3]))
    # With the attitude at mid-interval, as the strapdown has it.
    f = plus(dvelocity, 0.5, cross(get(flight.dtheta[k], 0), dvelocity))
    f_n = rotate(C_nb, (f[0] / flight.dt, f[1] / flight.dt, f[2] / flight.dt))
    for i in range(3):
        F[P + i, V + i] = 1.0
        u, v, w = C_en[i]
        for j in range(3):
            a, b, d = C_en[j]
            # Gravity changes its size along down with latitude and height, and turns with the place by g / R.
            F[V + i, P + j] = w * (slope * a - by_height * d) - north * u * a - east * v * b
            C = u * C_nb[0][j] + v * C_nb[1][j] + w * C_nb[2][j]
            F[V + i, B + j], F[A + i, G + j] = -C, C
    skew(F, V, V, (0.0, 0.0, -2 * earth.RATE))
    skew(F, V, A, rotate(C_en, f_n))
    skew(F, A, A, (0.0, 0.0, -earth.RATE))


@kernel
def _clear(out: Transition) -> None:
    """Write the transition over no time."""
    for part in (out.navigation, out.bias, out.fading, out.driven):
        part[:, :] = 0.0
    for stack in (out.coupled, out.process, out.covariance, out.cross):
        stack[:, :, :] = 0.0
    out.power[:] = 1.0
    for i in range(NAV):
        out.navigation[i, i] = 1.0


@inline_kernel
def _respond(
    flight: FlightArrays,
    k: int,
    F: FloatArray,
    fade: FloatArray,
    r: FloatArray,
    row: FloatArray,
    out: Transition,
) -> None:
    """Write the response r (9, 6) to errors of the IMU in sample k, and prepend the sample."""
    L, dt = out.navigation, flight.dt
    for i in range(NAV):
        for j in range(BIASES):
            total = 0.0
            for m in range(NAV):
                total += L[i, m] * F[m, NAV + j]
            r[i, j] = dt * total
            out.bias[i, j] += r[i, j]
            for a in range(3):
                # Increments are rates times Δt already, so that Δt is not in `total`.
                out.coupled[i, j, a] += total * flight.dtheta[k, a]
                out.coupled[i, j, 3 + a] += total * flight.dvelocity[k, a]
        for b in range(fade.size):
            # What is there of later samples meets an error that has decayed by one sample more.
            out.fading[i, b] = r[i, b % BIASES] + fade[b] * out.fading[i, b]
        for j in range(NAV):
            total = 0.0
            for m in range(NAV):
                total += L[i, m] * F[m, j]
            row[j] = total
        for j in range(NAV):
            # L (I + F Δt): the sample comes before all that L has.
            L[i, j] += dt * row[j]


@inline_kernel
def _drive(p: int, channel: int, decay: float, drive: FloatArray, r: FloatArray, out: Transition) -> None:
    """Prepend the effect of process p in a sample."""
    for j in range(3):
        for i in range(NAV):
            s = r[i, 3 * channel + j] + decay * out.process[p, i, j]
            out.process[p, i, j] = s
            out.cross[p, i, j] += drive[j] * out.power[p] * s
            for m in range(i + 1):
                # Only up to i: further responses of this sample are not written yet.
                c = drive[j] * s * out.process[p, m, j]
                out.covariance[p, i, m] += c
                if m < i:
                    out.covariance[p, m, i] += c
    out.power[p] *= decay


@entry_kernel
def transition(
    flight: FlightArrays,
    first: int,
    last: int,
    fade: FloatArray,
    processes: Processes,
    known: FloatArray,
    out: Transition,
) -> None:
    """Write the transition from sample `first` to sample `last` of a flight.

    Parameters
    ----------
    flight
        The flight.
    first, last
        First and last sample of the interval; equal samples give the transition over no time.
    fade : (b,) array
        The filter's decay in one sample of the biases, and of further states that act as these do.
    processes
        Random errors of the IMU.
    known : (s, n, 6) array
        Known errors of the IMU in each sample, as errors of the bias estimates.
    out
        Receives the transition.
    """
    F = np.zeros((N, N))
    r, row = np.zeros((NAV, BIASES)), np.zeros(NAV)
    _clear(out)
    # Backwards: the response to an error in a sample is that of all later ones, which are known by then.
    for k in range(last - 1, first - 1, -1):
        _write(flight, k, F)
        _respond(flight, k, F, fade, r, row, out)
        for p in range(processes.decay.size):
            _drive(p, processes.channel[p], processes.decay[p], processes.drive[p], r, out)
        for s in range(known.shape[0]):
            for i in range(NAV):
                for j in range(BIASES):
                    out.driven[s, i] += r[i, j] * known[s, k, j]
