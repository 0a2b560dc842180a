"""Simulated transport: a simulated device with a line of its own, as one source of bytes."""

from __future__ import annotations

from functools import cached_property

from lab.live.address import Address
from lab.live.serial_port import SerialPort
from lab.live.simulated_device import SimulatedDevice
from lab.live.tcp_connection import TcpConnection
from lab.live.transport import Chunk, Transport
from lab.live.true_motion import TrueFlight

LATE = 0.1
"""Delay from which it is said that the device delivers late [s]: the time between two pictures."""


class SimulatedTransport:
    """Reads a simulated device through its line; a `Transport`.

    Parameters
    ----------
    address
        The address it was opened by.
    device
        The device; it is started with the first `open` and ended with `end`.
    """

    reconnects = True

    def __init__(self, address: str, device: SimulatedDevice) -> None:
        self.address = address
        self.device = device
        self._begun = False
        self._line: Transport | None = None

    @cached_property
    def truth(self) -> TrueFlight:
        """The true motion of the device."""
        truth = self.device.flight.result.truth_arrays
        assert truth is not None  # of a simulation
        return TrueFlight(truth, lambda: self.device.begun)

    @property
    def remark(self) -> str:
        """How late the device delivers; empty if it is in time."""
        late = self.device.late
        return f"The device delivers {late:.1f} s late: this computer is too busy." if late > LATE else ""

    def open(self) -> None:
        """Open the line of the device.

        Raises
        ------
        OSError
            If it is unplugged.
        """
        if not self._begun:
            self.device.plug()
        if not self.device.plugged:
            raise OSError("the simulated device is unplugged")
        address = Address.of(self.device.address)
        line: Transport = SerialPort(address) if address.kind == "serial" else TcpConnection(address)
        line.open()
        self._line = line
        if not self._begun:
            self._begun = True
            self.device.start()

    def read(self, longest: float) -> Chunk:
        """Wait for bytes.

        Raises
        ------
        OSError
            If the device is unplugged.
        EOFError
            When the flight is over.
        """
        assert self._line is not None
        over = self.device.finished
        chunk = self._line.read(longest)
        if over and not chunk.data:
            raise EOFError("The flight is over.")
        return chunk

    def close(self) -> None:
        """Close the line."""
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def end(self) -> None:
        """End the device."""
        self.device.close()
