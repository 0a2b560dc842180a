"""A stand-in for X-Plane that runs in real time: subscribers, a pause, another pace, jumps, loss, silence."""

from __future__ import annotations

import struct
import time
from dataclasses import fields

import numpy as np
from xplane_sender import frames_of
from xplane_stand_in import XPlaneStandIn

from lab.missions import Recording, mission
from lab.motion.recordings.recording import Frame

STEP = 0.02
"""Interval of frames at 50 Hz [s]."""


def montreal(seconds: float) -> Recording:
    """Return the first seconds of a mission."""
    whole = mission("montreal").recording
    kept = whole.time - whole.time[0] <= seconds
    return Recording(*(getattr(whole, field.name)[kept] for field in fields(Recording)))


def standing_first(recording: Recording, seconds: float) -> Recording:
    """Return a recording that begins at rest, with a rest of some seconds before it."""
    step = float(recording.time[1] - recording.time[0])
    count = round(seconds / step)
    found = {}
    for name in (field.name for field in fields(Recording)):
        values = getattr(recording, name)
        if isinstance(values, np.ndarray) and name != "time":
            values = np.concatenate((np.repeat(values[:1], count, axis=0), values))
        found[name] = values
    found["time"] = recording.time[0] + step * np.arange(found["latitude"].size)
    found["velocity_n"][:count] = 0.0
    return Recording(**found)


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


class XPlaneSimulator(XPlaneStandIn):
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
    """

    def __init__(self, recording: Recording, port: int = 0) -> None:
        super().__init__(port)
        self.paused = self.silent = False
        self.pace = 1.0
        self.lose = 0
        self.noise = b""
        self.clock = True
        self._time = recording.time - recording.time[0]
        self._frames = frames_of(recording)
        self._at = 0.0  # time of the recording
        self._jump = 0.0  # by which it goes on next
        self._shown = 0.0  # by the clock, since the start

    def jump(self, seconds: float) -> None:
        """Go to another time of the recording, while the clock goes on."""
        self._jump = seconds

    def _run(self) -> None:
        begun = last = time.monotonic()
        flown, sent = 0.0, -1
        while not self._stop.wait(2e-3):
            while self._listen():
                pass
            now = time.monotonic()
            if not self.paused:
                flown += self.pace * (now - last)
                self._at += self.pace * (now - last)
            last = now
            jump, self._jump = self._jump, 0.0
            self._at += jump
            frame = int(np.searchsorted(self._time, self._at, side="right")) - 1
            if frame == sent and now - begun < 0.05:  # a paused X-Plane sends its last frame again
                continue
            begun = now
            # On a busy computer several are due: X-Plane would be slower then, not leave frames out.
            for due in range(frame if jump else min(sent + 1, frame), frame + 1):
                if due != sent:  # a jump within the recording does not turn the clock back
                    self._shown = max(flown - (self._at - self._time[due]), self._shown + 2e-3)
                self._send(due)
                sent = due

    def _send(self, frame: int) -> None:
        if self.lose:
            self.lose -= 1
            return
        position, values = self._frames[frame]
        values = values | {"sim/time/total_flight_time_sec": 1000.0 + self._shown}
        for place, who in list(self.subscribers.items()):
            if self.silent:
                continue
            for packet in (self.noise, who.answer(values) * self.clock, b"RPOS4" + position):
                if packet:
                    self._udp.sendto(packet, place)
