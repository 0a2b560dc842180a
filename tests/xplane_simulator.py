"""A stand-in for X-Plane that runs in real time: subscribers, a pause, another pace, jumps, loss, silence."""

from __future__ import annotations

import socket
import struct
import threading
import time
from dataclasses import dataclass, field, fields
from typing import Self

import numpy as np
from xplane_sender import frames_of

from lab.missions import Recording, mission
from lab.recordings.frame import Frame

STEP = 0.02
"""Interval of frames at 50 Hz [s]."""


def montreal(seconds: float) -> Recording:
    """Return the first seconds of a mission."""
    whole = mission("montreal").recording
    kept = whole.time - whole.time[0] <= seconds
    return Recording(*(getattr(whole, field.name)[kept] for field in fields(Recording)))


def packets(frame: Frame, clock: float | None = None) -> tuple[bytes, bytes]:
    """Return RPOS and RREF of a frame; the reference point of the local frame is below the aircraft."""
    latitude, longitude, height = frame.position
    north, east, down = frame.velocity_n
    roll, pitch, yaw = np.degrees(frame.euler)
    position = struct.pack(
        "<dddffffffffff", np.degrees(longitude), np.degrees(latitude), height, 0.0, pitch, yaw % 360, roll,
        east, -down, -north, 0.0, 0.0, 0.0,
    )  # fmt: skip
    values = (frame.time if clock is None else clock, 0.0, 0.0, 60.0, 0.0, 0.0)
    return b"RPOS4" + position, b"RREF," + b"".join(struct.pack("<if", *row) for row in enumerate(values))


@dataclass
class Subscriber:
    """Who asked for what: the rate of positions [Hz], and the names of references by their numbers."""

    rate: int = 0
    references: dict[int, str] = field(default_factory=dict)


class XPlaneSimulator:
    """Flies a recording in real time, and sends each frame to all who asked.

    Parameters
    ----------
    recording : Recording
        What is flown; at its end the clock stands still.
    port : int
        Where to listen; zero for any free port.

    Attributes
    ----------
    paused, silent : bool
        Whether the clock stands still, and whether nothing is sent.
    pace : float
        How much faster than real time it flies.
    lose : int
        Frames that are lost from now on.
    noise : bytes
        A packet sent before each frame, if not empty.
    clock : bool
        Whether data references are answered.
    subscribers : dict
        Who has asked, by address.
    """

    def __init__(self, recording: Recording, port: int = 0) -> None:
        self.paused = self.silent = False
        self.pace = 1.0
        self.lose = 0
        self.noise = b""
        self.clock = True
        self.subscribers: dict[tuple[str, int], Subscriber] = {}
        self._time = recording.time - recording.time[0]
        self._frames = frames_of(recording)
        self._at = 0.0  # time of the recording
        self._shown = 0.0  # by the clock, since the start
        self._stop = threading.Event()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(("127.0.0.1", port))
        self.port: int = self._udp.getsockname()[1]
        self._thread = threading.Thread(target=self._run, name="simulated X-Plane", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._udp.close()

    def jump(self, seconds: float) -> None:
        """Go to another time of the recording, while the clock goes on."""
        self._at += seconds

    def _listen(self) -> None:
        self._udp.settimeout(0.0)
        while True:
            try:
                packet, sender = self._udp.recvfrom(2048)
            except (BlockingIOError, ConnectionError):
                return
            who = self.subscribers.setdefault(sender, Subscriber())
            if packet.startswith(b"RPOS\0"):
                who.rate = int(packet[5:].split(b"\0")[0])
            elif packet.startswith(b"RREF\0"):
                rate, index, name = struct.unpack("<5xii400s", packet)
                who.references[index] = name.split(b"\0")[0].decode()
                if not rate:
                    who.references.pop(index)
            if not who.rate and not who.references:
                del self.subscribers[sender]

    def _run(self) -> None:
        begun = last = time.monotonic()
        flown, sent = 0.0, -1
        while not self._stop.wait(2e-3):
            self._listen()
            now = time.monotonic()
            if not self.paused:
                flown += self.pace * (now - last)
                self._at += self.pace * (now - last)
            last = now
            frame = int(np.searchsorted(self._time, self._at, side="right")) - 1
            if frame == sent and now - begun < 0.05:  # a paused X-Plane sends its last frame again
                continue
            begun, ahead = now, self._at - self._time[frame]
            if frame != sent:  # a jump within the recording does not turn the clock back
                self._shown = max(flown - ahead, self._shown + 2e-3)
            self._send(frame)
            sent = frame

    def _send(self, frame: int) -> None:
        if self.lose:
            self.lose -= 1
            return
        position, values = self._frames[frame]
        values = values | {"sim/time/total_flight_time_sec": 1000.0 + self._shown}
        for place, who in list(self.subscribers.items()):
            if self.silent:
                continue
            references = b"RREF," + b"".join(
                struct.pack("<if", index, values[name]) for index, name in who.references.items()
            )
            for packet in (self.noise, references * self.clock, b"RPOS4" + position):
                if packet:
                    self._udp.sendto(packet, place)
