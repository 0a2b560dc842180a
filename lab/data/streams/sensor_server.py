"""SensorServer: reads the Android app of this name, a WebSocket server on the phone.

References
----------
U. Farooq, *SensorServer* (README.md): ``/sensors/connect?types=[...]`` sends a message for each reading, with
``type``, ``timestamp`` [ns since the phone was switched on] and ``values``.
"""

from __future__ import annotations

import contextlib
import json
import math
import time
from typing import Any, Final
from urllib.parse import quote

from lab.data.protocols.json_rows import number, parse_json
from lab.data.protocols.phone_line import MOST_SAMPLES, RADIANS, PhoneLine, Row
from lab.data.streams.address import LAST_PORT
from lab.data.streams.transport import Chunk, TransportError

AXES: Final = 3
"""Numbers of a sample; more are left out."""
KINDS: Final = {
    "android.sensor.accelerometer": "force",
    "android.sensor.gyroscope": "rate",
    "android.sensor.magnetic_field": "magnetic",
}
"""Sensors that are asked for, and the field of `PhoneLine` that holds them."""
_PREFIX: Final = "sensorserver:"
_LARGEST: Final = 2**14
"""Largest message [bytes]; a reading has about 150."""
_LARGEST_STAMP: Final = 2**63
"""Largest time stamp [ns]: the app writes a signed number of 64 bits."""
_OPENING: Final = 5.0
"""Longest time for connecting [s]."""
_TOGETHER: Final = 0.02
"""Longest time for which readings are gathered into a line [s]: a line for each would cost 400 a second."""
_MICRO: Final = 1e-6  # [T/µT]


class SensorServerTransport:
    """Reads the app; a `lab.data.streams.transport.Transport`. The bytes are lines for the decoder ``phone``.

    Parameters
    ----------
    address
        ``sensorserver:HOST:PORT``, such as ``sensorserver:192.168.0.5:8080``; the app shows host and port.

    Raises
    ------
    TransportError
        If the address has another form.
    """

    def __init__(self, address: str) -> None:
        host, _, port = address.removeprefix(_PREFIX).rpartition(":")
        is_port = port.isdecimal() and 0 < int(port) <= LAST_PORT
        if not address.startswith(_PREFIX) or not host or not is_port:
            raise TransportError(
                f"{address!r} is no address of SensorServer; accepted is {_PREFIX}HOST:PORT, such as "
                f"{_PREFIX}192.168.0.5:8080"
            )
        self.address = address
        self.reconnects = True
        types = quote(json.dumps(list(KINDS), separators=(",", ":")))
        self._url = f"ws://{host}:{port}/sensors/connect?types={types}"
        self._socket: Any = None
        self._number = 0

    def open(self) -> None:
        """Connect to the app.

        Raises
        ------
        OSError
            If it does not answer, or is another program.
        """
        from websockets.exceptions import WebSocketException  # noqa: PLC0415 - needed with the app only
        from websockets.sync.client import connect  # noqa: PLC0415

        self.close()
        try:
            self._socket = connect(
                self._url, open_timeout=_OPENING, close_timeout=1, max_size=_LARGEST, max_queue=64, proxy=None
            )
        except (OSError, WebSocketException, ValueError) as error:
            raise OSError(f"{self.address} does not answer as SensorServer does: {error}") from error

    def read(self, longest: float) -> Chunk:
        """Wait for readings; as of `lab.data.streams.transport.Transport`.

        Raises
        ------
        OSError
            If the app is gone.
        """
        from websockets.exceptions import WebSocketException  # noqa: PLC0415

        socket = self._socket
        if socket is None:
            raise OSError(f"{self.address} is not open")
        line = PhoneLine(self._number, source="SensorServer", unit=RADIANS)
        deadline = time.monotonic() + longest
        while all(len(getattr(line, name)) < MOST_SAMPLES for name in KINDS.values()):
            try:
                message = socket.recv(timeout=max(deadline - time.monotonic(), 0.0))
            except TimeoutError:
                break
            except (OSError, WebSocketException) as error:
                raise OSError(f"{self.address} is gone: {error}") from error
            if not line.force and not line.rate and not line.magnetic:
                deadline = min(deadline, time.monotonic() + _TOGETHER)
            _add(message, line)
        now = time.monotonic()
        if not (line.force or line.rate or line.magnetic):
            return Chunk(now, b"")
        self._number += 1
        return Chunk(now, line.written())

    def close(self) -> None:
        """Disconnect; may be called from any thread, repeatedly, and ends a waiting `read`."""
        socket, self._socket = self._socket, None
        if socket is not None:
            with contextlib.suppress(Exception):
                socket.close()


def _add(message: str | bytes, line: PhoneLine) -> None:
    """Add a reading to a line; anything else is left out."""
    said = parse_json(message.encode() if isinstance(message, str) else message)
    if not isinstance(said, dict) or type(said.get("timestamp")) is not int:
        return
    kind, values, stamp = said.get("type"), said.get("values"), said["timestamp"]
    field = KINDS.get(kind) if isinstance(kind, str) else None
    if field is None or not isinstance(values, list) or len(values) < AXES or abs(stamp) > _LARGEST_STAMP:
        return
    unit = _MICRO if field == "magnetic" else 1.0
    row: Row = [stamp / 1e9, *(unit * number(one) for one in values[:AXES])]
    if not any(map(math.isnan, row)):
        getattr(line, field).append(row)
