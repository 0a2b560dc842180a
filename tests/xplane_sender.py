"""A stand-in for X-Plane: it answers requests over real UDP by replaying a recording, frame by frame."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Self

import numpy as np
import pymap3d
from writers.xplane_data import euler_rate

from lab.missions import Recording
from lab.rotation import body_rate

REFERENCE = (0.2, -0.25)
"""How far the reference point of the local frame is from the start, in latitude and longitude [°]."""
CLOCK = 1000.0
"""What the simulator's clock shows at the start [s]."""


class XPlaneSender:
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
    requests : list of bytes
        What was asked.
    rate : int
        The rate asked for last [Hz].
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
        self.received: Callable[[], int] = int
        self._clock_first = clock_first
        self._skip = skip
        self._answers = answers
        self._noise = noise
        self._frames = frames_of(recording)
        self._asked: dict[int, str] = {}
        self.rate = 0
        self.requests: list[bytes] = []
        self.done = threading.Event()
        self._stop = threading.Event()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(("127.0.0.1", port))
        self._udp.settimeout(0.05)
        self.port: int = self._udp.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._udp.close()

    def _listen(self) -> tuple[str, int] | None:
        try:
            packet, sender = self._udp.recvfrom(2048)
        except TimeoutError:
            return None
        self.requests.append(packet)
        if packet.startswith(b"RPOS\0"):
            self.rate = int(packet[5:].split(b"\0")[0])
        elif packet.startswith(b"RREF\0"):
            rate, index, name = struct.unpack("<5xii400s", packet)
            self._asked[index] = name.split(b"\0")[0].decode()
            if not rate:
                self._asked.pop(index)
        return sender

    def _serve(self) -> None:
        client = None
        while not self._stop.is_set() and (client is None or len(self._asked) < 6):
            client = self._listen() or client
        for i, (position, values) in enumerate(self._frames):
            if self._stop.is_set() or client is None:
                return
            sends = i % self._skip == 0
            clock = b"RREF," + b"".join(
                struct.pack("<if", index, values[name]) for index, name in self._asked.items()
            )
            packets = [b"RPOS4" + position] * sends + [clock] * self._answers
            for packet in [*self._noise, *(reversed(packets) if self._clock_first else packets)]:
                self._udp.sendto(packet, client)
            while self.received() <= i // self._skip and not self._stop.is_set():
                time.sleep(2e-4)
            time.sleep(5e-4)  # a frame takes longer than the way between its packets
        self.done.set()
        while not self._stop.is_set():
            self._listen()


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
