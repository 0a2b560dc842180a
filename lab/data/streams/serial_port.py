"""Serial port: bytes of a device on a serial line, and the ports that this computer has."""

from __future__ import annotations

import os
import time
from typing import Any, NamedTuple

from lab.data.streams.address import Address
from lab.data.streams.transport import Chunk, TransportError, in_words

BAUD = 115_200
"""Usual speed of the line [bit/s]; those of USB do not heed it."""
BAUDS = (300, 12_000_000)
"""Speeds that are accepted [bit/s]: the slowest in use, and the fastest of USB bridges."""
OPTIONS = ("baud",)
"""Options of a serial address."""
_INSTALL = "serial ports need pyserial: pip install 'ins-lab[live]'"


class Port(NamedTuple):
    """A serial port of this computer.

    Attributes
    ----------
    address : str
        Address that opens it; where Linux has one, by the name of the device, which stays the same in
        another socket.
    name : str
        Name of the port, such as ``/dev/ttyUSB0``.
    description : str
        What the device says of itself.
    """

    address: str
    name: str
    description: str


def serial_ports() -> list[Port]:
    """Return the serial ports of this computer; those with a device of USB first.

    Raises
    ------
    TransportError
        If pyserial is not installed.
    """
    try:
        from serial.tools.list_ports import comports  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise TransportError(_INSTALL) from error
    lasting = _names_by_device()
    found = sorted(comports(), key=lambda port: (port.vid is None, port.device))
    return [
        Port(
            f"serial:{lasting.get(port.device, port.device)}",
            port.device,
            " ".join(part for part in (port.manufacturer, port.description) if part and part != "n/a"),
        )
        for port in found
    ]


def _names_by_device() -> dict[str, str]:
    """Return the lasting names that Linux gives to serial devices, by the name of the port."""
    from pathlib import Path  # noqa: PLC0415 - only here

    folder = Path("/dev/serial/by-id")
    try:
        return {str(path.resolve()): str(path) for path in sorted(folder.iterdir())}
    except OSError:
        return {}


class SerialPort:
    """Bytes of a serial port; a `Transport`.

    Parameters
    ----------
    address
        Such as ``serial:/dev/ttyUSB0?baud=115200``.

    Raises
    ------
    TransportError
        If the speed is not accepted, or pyserial is not installed.
    """

    reconnects = True

    def __init__(self, address: Address) -> None:
        address.check(OPTIONS)
        self.address = str(address)
        self._name = address.place
        self._baud = address.whole("baud", BAUD, *BAUDS)
        try:
            import serial  # noqa: F401, PLC0415 - an extra
        except ImportError as error:
            raise TransportError(_INSTALL) from error
        self._port: Any = None

    def open(self) -> None:
        """Open the port for this program alone.

        Raises
        ------
        OSError
            If it is not there, in use, or not allowed.
        """
        import serial  # noqa: PLC0415 - an extra

        try:
            self._port = serial.Serial(self._name, self._baud, timeout=0, exclusive=True)
        except serial.SerialException as error:
            raise OSError(f"{self._name}: {_describe_error(error)}") from error
        except ValueError as error:
            raise OSError(f"{self._name}: {error}") from error

    def read(self, longest: float) -> Chunk:
        """Wait for the first byte, and return all that are there.

        A read of many bytes would wait for the last of them, 5 to 12 ms at 115 200 bit/s.

        Raises
        ------
        OSError
            If the device is gone.
        """
        port = self._port
        port.timeout = longest
        try:
            data = port.read(1)
            if data and (more := port.in_waiting):
                data += port.read(more)
        except OSError as error:  # pyserial asks what happened, Linux names an input/output error
            raise OSError("the device was unplugged, or another program reads its port") from error
        return Chunk(time.monotonic(), bytes(data))

    def close(self) -> None:
        """Free the port."""
        port, self._port = self._port, None
        if port is not None:
            port.close()


def _describe_error(error: Any) -> str:
    """Return why pyserial cannot open a port; what it says of its settings has the number in its cause."""
    cause = error.__context__
    number = error.errno or (cause.args[0] if cause is not None and cause.args else None)
    words = in_words(number) if isinstance(number, int) else ""
    return words or (os.strerror(error.errno) if error.errno else str(error))
