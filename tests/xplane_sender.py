"""A stand-in for X-Plane: it answers requests over real UDP by replaying a recording, frame by frame."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable

import numpy as np
import pymap3d
from writers.xplane_data import euler_rate
from xplane_stand_in import Place, Subscriber, XPlaneStandIn

from lab.missions import Recording
from lab.motion.frames.rotation import body_rate

REFERENCE = (0.2, -0.25)
"""How far the reference point of the local frame is from the start, in latitude and longitude [°]."""
CLOCK = 1000.0
"""What the simulator's clock shows at the start [s]."""
_WAKE = 0.05  # longest wait for a request [s]


class XPlaneSender(XPlaneStandIn):
    """Waits for requests at a port of its own, and sends what was asked for.

    Parameters
    ----------
    recording : Recording
        What is flown.
    clock_first : bool
        Whether the data references go before the position of a frame.
    skip : int
        Positions go with every so many frames only.
    answers : bool
        False for an X-Plane that does not know data references.
    noise : tuple of bytes
        Packets sent in between.
    port : int
        Where to listen; zero for any free port.

    Attributes
    ----------
    received : callable
        How many positions have come through: the next frame follows when the last is there, so that nothing
        is lost however slow the machine.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        clock_first: bool = True,
        skip: int = 1,
        answers: bool = True,
        noise: tuple[bytes, ...] = (),
        port: int = 0,
    ) -> None:
        super().__init__(port)
        self.received: Callable[[], int] = int
        self._clock_first = clock_first
        self._skip = skip
        self._answers = answers
        self._noise = noise
        self._frames = frames_of(recording)
        self.done = threading.Event()

    @property
    def rate(self) -> int:
        """The rate asked for now [Hz]; zero if nobody asks."""
        return max((who.rate for who in self.subscribers.values()), default=0)

    def _known(self) -> tuple[Place, Subscriber] | None:
        """Return who has asked for everything, if somebody has."""
        return next(((p, who) for p, who in self.subscribers.items() if len(who.references) >= 6), None)

    def _run(self) -> None:
        while not self._stop.is_set() and self._known() is None:
            self._listen(_WAKE)
        known = self._known()
        for i, (position, values) in enumerate(self._frames):
            if self._stop.is_set() or known is None:
                return
            client, who = known
            sends = i % self._skip == 0
            packets = [b"RPOS4" + position] * sends + [who.answer(values)] * self._answers
            for packet in [*self._noise, *(reversed(packets) if self._clock_first else packets)]:
                self._udp.sendto(packet, client)
            while self.received() <= i // self._skip and not self._stop.is_set():
                time.sleep(2e-4)
            time.sleep(5e-4)  # a frame takes longer than the way between its packets
        self.done.set()
        while not self._stop.is_set():
            self._listen(_WAKE)


def frames_of(recording: Recording) -> list[tuple[bytes, dict[str, float]]]:
    """Return for each sample the record of RPOS and the data references."""
    latitude, longitude = np.degrees(recording.latitude), np.degrees(recording.longitude)
    lat0, lon0 = latitude[0] + REFERENCE[0], longitude[0] + REFERENCE[1]
    east, north, _ = pymap3d.geodetic2enu(latitude, longitude, recording.height, lat0, lon0, 0.0)
    vn, ve, vd = recording.velocity_n.T
    in_e = pymap3d.enu2uvw(ve, vn, -vd, latitude, longitude)
    v_east, v_north, v_up = pymap3d.uvw2enu(*in_e, lat0, lon0)
    roll, pitch, yaw = np.degrees(recording.euler).T
    rate = body_rate(recording.euler, euler_rate(recording))
    zero = np.zeros(len(latitude))
    airspeed, alpha, beta = (
        zero if value is None else value for value in (recording.airspeed, recording.alpha, recording.beta)
    )
    positions = zip(
        longitude, latitude, recording.height, zero, pitch, yaw % 360.0, roll, v_east, v_up, -v_north,
        *rate.T, strict=True,
    )  # fmt: skip
    names = {
        "sim/time/total_flight_time_sec": recording.time - recording.time[0] + CLOCK,
        "sim/flightmodel/position/local_x": east,
        "sim/flightmodel/position/local_z": -north,
        "sim/flightmodel/position/true_airspeed": airspeed,
        "sim/flightmodel/position/alpha": np.degrees(alpha),
        "sim/flightmodel/position/beta": np.degrees(beta),
    }
    return [
        (struct.pack("<dddffffffffff", *row), {name: float(values[i]) for name, values in names.items()})
        for i, row in enumerate(positions)
    ]
