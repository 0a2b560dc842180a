"""Driver: strapdown and filter over IMU increments and GPS fixes, generated for each error model.

`driver` gives the one compiled loop: a batch run passes a whole flight, a live run passes one sample at a
time. The loop is written with the kernels of `phi`, 15 states and the north-slaved mechanization. For another
filter, `steps` says which kernels and constants it has in their place (`generation`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from lab.navigation import strapdown
from lab.navigation.filters.correction import correct, corrections, has_estimate, write_corrected_state
from lab.navigation.filters.error_models import ErrorModel, write_f
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.held_heading import straighten
from lab.navigation.filters.kalman import RECOVERED, REJECTED
from lab.navigation.filters.north_slaved import difference, leaves_frame
from lab.navigation.filters.observation import observations, observe, observe_aid, observe_rest
from lab.navigation.filters.prediction import (
    add_noise,
    add_noise_in_body,
    build_kept_part,
    kept_part,
    predict,
    predict_over_sums,
)
from lab.navigation.filters.schedule import SLACK, Schedule
from lab.navigation.filters.user_states import user_kernels
from lab.navigation.kernels.compilation import (
    embedded_kernel,
    kernel,
    loop_kernel,
    passing_loop_kernel,
)
from lab.navigation.kernels.generation import Generated, Kernel, Redecorated, Variant, generate_module
from lab.navigation.kernels.propagation import build_propagate, layout_constants, propagate
from lab.navigation.kernels.storage import store, store_fix, storing
from lab.navigation.solution import Fixes, Imu, Solution
from lab.navigation.standstill import HELD, gather_rest, hold_attitude
from lab.navigation.strapdown import get, step

Advance = Callable[[Filter, Imu, Fixes, Solution, int, Schedule], int]


@embedded_kernel
def aid_due(run: Filter, time: float, dt: float) -> bool:
    """Return False: without aids, no measurement of theirs is ever due."""
    return False


@embedded_kernel
def take_aids(
    run: Filter, out: Solution, k: int, time: float, dt: float, schedule: Schedule, pending: bool
) -> bool:
    """Return whether an estimated error is pending: without aids, it stays so."""
    return pending


@embedded_kernel
def _aid_due(run: Filter, time: float, dt: float) -> bool:
    """Return whether a measurement of the aids is due at a time."""
    a, times = run.counts[2], run.aids.time
    return bool(a < times.size and times[a] <= time + SLACK * dt)


@kernel
def _take_aids(
    run: Filter, out: Solution, k: int, time: float, dt: float, schedule: Schedule, pending: bool
) -> bool:
    """Apply the measurements of the aids that are due at sample k; return whether an estimate is pending."""
    while _aid_due(run, time, dt):
        a = run.counts[2]
        age = time - run.aids.time[a]
        if age <= dt * (1 + SLACK) and observe_aid(run, a, age, dt, schedule, out):
            out.aid_sample[a] = k + 1
            pending = True
            if schedule.feedback and time - run.clock[0] >= schedule.correction_period - SLACK * dt:
                correct(run.state, run.w, run.T)
                run.clock[0] = time
                pending = False
        run.counts[2] = a + 1
    return pending


SETTLED, PENDING = 0, 1
"""State of a navigator after measurements: corrected, or with an estimated error that is still pending."""


@kernel
def take_measurements(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    k: int,
    schedule: Schedule,
    pending: bool,
) -> int:
    """Apply the measurements due at sample k to a navigator; return `SETTLED` or `PENDING`.

    Fixes come last, so that P after a fix is P after the sample.

    A loop over samples skips the call if no measurement is due: with so many arrays, a call takes half the
    time of a sample.
    """
    state, w, T, z, x, spare = run.state, run.w, run.T, run.z, run.x, run.spare
    counts, clock, rest_sums = run.counts, run.clock, run.rest_sums
    fix_time, position, velocity_n = fixes.time, fixes.position, fixes.velocity_n
    fix_sample, fix_rejected, fix_recovered = out.fix_sample, out.fix_rejected, out.fix_recovered
    fix_covariance, rest_updates = out.fix_covariance, out.rest
    time, rests = imu.time[k + 1], imu.rest.size > 0 and imu.rest[k]
    dt = time - imu.time[k]
    m = counts[0]
    fix_due = m < fix_time.size and fix_time[m] <= time + SLACK * dt
    if rests and gather_rest(state, rest_sums, dt) and observe_rest(run):
        rest_updates[k + 1] = True
        pending = True
        if schedule.feedback and time - clock[0] >= schedule.correction_period - SLACK * dt:
            correct(state, w, T)
            clock[0] = time
            pending = False
    pending = take_aids(run, out, k, time, dt, schedule, pending)
    while fix_due:
        age = time - fix_time[m]
        if age <= dt * (1 + SLACK):
            difference(state, age, age / dt, position[m], velocity_n[m], z)
            became = observe(run, m, age, time, schedule, z, out)
            if became == REJECTED:
                fix_rejected[m] = True
            else:
                fix_sample[m] = k + 1
                fix_recovered[m] = became == RECOVERED
                pending = True
                if schedule.feedback and time - clock[0] >= schedule.correction_period - SLACK * dt:
                    correct(state, w, T)
                    clock[0] = time
                    pending = False
                if pending:
                    # The navigator itself stays uncorrected: what is stored is the estimate as it is known
                    # now.
                    write_corrected_state(state, w, T, x, spare)
                store_fix(fix_covariance[m], spare if pending else state, w, T)
        m += 1
        counts[0] = m
        fix_due = m < fix_time.size and fix_time[m] <= time + SLACK * dt
    return PENDING if pending else SETTLED


@loop_kernel
def advance(run: Filter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule) -> int:
    """Advance a navigator over `imu` from increment `first` on; return the increment where it stopped.

    It stops early, between two samples, where it must go on in another frame (`frames`).
    """
    state, w, T, x, spare = run.state, run.w, run.T, run.x, run.spare
    F, counts, rest_sums = run.F, run.counts, run.rest_sums
    times, dtheta, dvelocity, rest, fix_time = imu.time, imu.dtheta, imu.dvelocity, imu.rest, fixes.time
    fix_held = out.fix_held
    left = PENDING if has_estimate(w) else SETTLED
    if first == 0:
        store(out, 0, state, w, T)
    for k in range(first, dtheta.shape[0]):
        # Sums over samples, and what is held at rest, are of the frame in which they began.
        if leaves_frame(state) and counts[1] == 0 and rest_sums[HELD] == 0:
            return k
        time, dt = times[k + 1], times[k + 1] - times[k]
        step(state, get(dtheta[k], 0), get(dvelocity[k], 0), dt)
        m = counts[0]
        due = m < fix_time.size and fix_time[m] <= time + SLACK * dt
        due |= aid_due(run, time, dt)
        if rest.size > 0:
            hold_attitude(state, rest_sums, rest[k])
        write_f(state, F)
        straighten(fix_held, m, state, run.P, F, dt)
        predict(run, dt, due, schedule.stride)
        if due or (rest.size > 0 and rest[k]):
            left = take_measurements(run, imu, fixes, out, k, schedule, left == PENDING)
        if left == PENDING:
            store(out, k + 1, write_corrected_state(state, w, T, x, spare), w, T)
        else:
            store(out, k + 1, state, w, T)
    return times.size - 1


@functools.cache
def steps(model: ErrorModel, *, summed: bool, aided: bool = False) -> Generated:
    """Return the kernels of a filter at each sample and each measurement, which all its loops call.

    Parameters
    ----------
    model
        The error model.
    summed
        For propagating P less often than at every sample.
    aided
        For measurements other than fixes.
    """
    own: dict[Any, Any] = {
        **corrections(model),
        **observations(model),
        **storing(model),
        **model.variant.kernels,
        **user_kernels(model.blocks),
        propagate: build_propagate(model),
        kept_part: build_kept_part(model),
    }
    if not model.blocks:
        # Without further blocks there are no scale factors: their divisions are left out.
        own |= strapdown.UNSCALED
    if model.in_body:
        own[add_noise] = add_noise_in_body
    if summed:
        own[predict] = predict_over_sums
    if aided:
        own |= {aid_due: _aid_due, take_aids: _take_aids}
    variant = Variant(own, {**model.variant.constants, **layout_constants(model.blocks)})
    name = _name(model, summed=summed, aided=aided)
    moving = step, write_f, straighten, predict
    roots = *moving, take_measurements, aid_due, write_corrected_state, has_estimate, store, store_fix
    return generate_module(f"steps {name}", f"The steps of the filter {name}.", roots, variant)


def _name(model: ErrorModel, *, summed: bool, aided: bool) -> str:
    """Return a filter in words."""
    return " ".join([model.label, *["sums"] * summed, *["aids"] * aided])


def loop(function: Kernel, model: ErrorModel, *, summed: bool = False, aided: bool = False) -> Kernel:
    """Return a loop over samples for a filter, which is compiled, or loaded from the disk, when first called.

    Parameters
    ----------
    function
        The loop, written with the kernels of this module.
    model, summed, aided
        As of `steps`.
    """
    parts = steps(model, summed=summed, aided=aided)
    own = parts.variant
    if user_kernels(model.blocks):
        # Functions of a notebook may change, also those that they call: nothing of them is kept on disk.
        own = Variant({**own.kernels, function: Redecorated(function, passing_loop_kernel)}, own.constants)
    name, what = _name(model, summed=summed, aided=aided), function.__name__
    title = f"The loop `{what}` of the filter {name}."
    made: Kernel = generate_module(f"{what} {name}", title, [function], own, [parts])[function]
    return made


@functools.cache
def driver(model: ErrorModel, *, summed: bool, aided: bool = False) -> Advance:
    """Return the driver of a model, which is compiled, or loaded from the disk, when first called.

    Parameters
    ----------
    model, summed, aided
        As of `steps`.
    """
    return loop(advance, model, summed=summed, aided=aided)
