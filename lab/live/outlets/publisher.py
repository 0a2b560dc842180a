"""Publisher: the thread that sends the states of a live navigator to all destinations."""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from lab.data.protocols.sent_solution import SentSolution
from lab.live.attitude_only import NORTH
from lab.live.live_state import COASTING, LiveState
from lab.live.outlets.destination import Destination
from lab.live.outlets.outlet import Outlet, make_outlet
from lab.live.pace import Pace

QUEUE: Final = 100
"""States that wait for the thread: two seconds at 50 Hz."""
POLE: Final = 90.0
"""Largest latitude [°]."""
NEAR: Final = 60.0
"""Largest distance of a sample from the clock of the host with which it counts as live [s]: in a replay,
times are those of the recording, mostly of days ago."""


class Publisher:
    """Sends states to destinations; as a context manager, it ends its thread and frees the ports.

    Attributes
    ----------
    behind : int
        States that were lost because the thread did not keep up.

    Parameters
    ----------
    destinations
        Where to send to.
    """

    def __init__(self, destinations: Sequence[Destination]) -> None:
        self.behind = 0
        self.destinations = tuple(destinations)
        self._paces = [Pace(1 / one.hz) for one in self.destinations]
        self._states: deque[LiveState] = deque(maxlen=QUEUE)
        self._outlets: list[Outlet] = []
        self._mean_sea: set[int] = set()
        self._loop = asyncio.new_event_loop()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="outlets", daemon=True)
        self._ready, self._ending = threading.Event(), asyncio.Event()

    @property
    def period(self) -> float:
        """Time between two rows of the fastest destination [s]."""
        return 1 / max((one.hz for one in self.destinations), default=1.0)

    def __enter__(self) -> Publisher:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open(self) -> None:
        """Open all destinations.

        Raises
        ------
        OSError
            If one cannot be opened; its text names the destination.
        ImportError
            If a library for one is not installed.
        """
        self._thread.start()
        self._ready.wait()
        if self._failure is not None:
            self._thread.join()
            raise self._failure

    def close(self) -> None:
        """Send what waits, and close all destinations; may be repeated."""
        if self._thread.ident is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._ending.set)
            self._thread.join()

    def offer(self, state: LiveState) -> None:
        """Take a state; called by the navigator's thread, which goes on at once."""
        self.behind += len(self._states) == QUEUE  # the oldest one gives way
        self._states.append(state)
        with contextlib.suppress(RuntimeError):  # it has ended
            self._loop.call_soon_threadsafe(self._send)

    @property
    def places(self) -> list[str]:
        """Where readers find the destinations, in words."""
        return [outlet.place for outlet in self._outlets]

    @property
    def counts(self) -> list[tuple[int, int, int]]:
        """Rows sent and lost, and readers so far, of each destination."""
        return [outlet.counts for outlet in self._outlets]

    @property
    def refused(self) -> list[str]:
        """Origins of pages that were refused."""
        return sorted({origin for outlet in self._outlets for origin in outlet.refused})

    @property
    def without_height(self) -> list[Destination]:
        """Destinations whose protocol has heights above sea level, while that of the solution is unknown."""
        return [self.destinations[number] for number in sorted(self._mean_sea)]

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._follow_navigator())
        finally:
            self._loop.run_until_complete(self._loop.shutdown_default_executor())  # of names
            self._loop.close()
            # Also after a failure, or `open` would wait for ever.
            self._ready.set()

    async def _follow_navigator(self) -> None:
        try:
            for destination in self.destinations:
                try:
                    outlet = make_outlet(destination)
                    await outlet.open()
                except (OSError, ImportError) as error:
                    error.add_note(destination.text)
                    self._failure = error
                    return
                self._outlets.append(outlet)
            self._ready.set()
            self._send()
            await self._ending.wait()
            self._send()
        finally:
            # Before the tasks are cancelled, which send what waits.
            await asyncio.gather(*(outlet.close() for outlet in self._outlets))
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

    def _send(self) -> None:
        """Send all states that wait, once all destinations are open."""
        while self._states and len(self._outlets) == len(self.destinations):
            state = self._states.popleft()
            if not math.isfinite(state.time):
                continue
            for number, (destination, pace) in enumerate(zip(self.destinations, self._paces, strict=True)):
                if not pace.is_due(state.time):
                    continue
                solution = sent_solution(state, destination.geoid, by_computer=destination.by_computer)
                self._outlets[number].send(solution)
                needs_sea = destination.kind != "mcap" and destination.protocol != "json"
                if needs_sea and solution.has_position and math.isnan(solution.sea_height):
                    self._mean_sea.add(number)


def sent_solution(state: LiveState, geoid: float = math.nan, *, by_computer: bool = False) -> SentSolution:
    """Return a state as it is sent.

    Parameters
    ----------
    state
        The state.
    geoid
        Height of the geoid above the ellipsoid [m]; NaN where it is not known.
    by_computer
        Whether the clock of the computer is UTC while the receiver gives none.
    """
    now = time.time()
    age = time.monotonic() - state.time
    unix = now - age if abs(age) < NEAR else now
    utc = state.time + state.utc_offset
    latitude, longitude = np.degrees(state.position[:2]).tolist()
    if not abs(latitude) <= POLE:
        latitude = math.nan
    euler = np.degrees(state.euler)
    euler[2] %= 360
    return SentSolution(
        time=state.time,
        utc=unix if math.isnan(utc) and by_computer else utc,
        unix=unix,
        phase=state.phase,
        coasts=state.phase == COASTING,
        latitude=latitude,
        longitude=(longitude + 180) % 360 - 180,
        height=float(state.position[2]),
        is_above_sea=state.is_above_sea,
        geoid=geoid,
        position_covariance=state.position_covariance,
        velocity_n=state.velocity_n,
        velocity_sigma=state.velocity_sigma,
        euler=euler,
        euler_sigma=np.degrees(state.euler_sigma),
        has_heading=bool(state.heading_source) and bool(state.euler_sigma[2] < NORTH),
        attitude_covariance=state.attitude_covariance,
        rate=np.degrees(state.rate),
        fixes_used=state.fixes_used,
        fixes_rejected=state.fixes_rejected,
    )
