"""Simulated transport: a simulated device with a line of its own, as one source of bytes."""

from __future__ import annotations

from functools import cached_property

from lab.data.streams.address import MAX_SEED, Address
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.network_transports import TcpConnection
from lab.data.streams.serial_port import SerialPort
from lab.data.streams.transport import Chunk, Transport, TransportError
from lab.live.simulated.simulated_device import Misbehaviour, SimulatedDevice, make_encoder
from lab.live.simulated.simulated_flight import REST, USUAL_REST, SimulatedFlight
from lab.live.simulated.simulated_link import local_link, make_link
from lab.motion.truth.growing_truth import TrueFlight

RATES = (1.0, 2000.0)
"""Rates of a simulated device [Hz]: above, its samples come several at a time."""
_LONGEST_REST = 3600.0  # before a flight, or of a device that stands still [s]
_MAX_CORRUPTION = 0.1  # part of the bytes: beyond, no frame is left
_MAX_JITTER = 1000.0  # [ms]
_MAX_DRIFT = 5000.0  # [ppm]: what a device clock follows
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
    def vehicle(self) -> str:
        """The vehicle that carries the device; empty if it is unknown."""
        return self.device.flight.vehicle

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
            raise EOFError("The flight has ended.")
        return chunk

    def close(self) -> None:
        """Close the line."""
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def end(self) -> None:
        """End the device."""
        self.device.close()


def open_simulated(address: Address) -> SimulatedTransport:
    """Return the simulated device of an address of the kind ``simulated``.

    Raises
    ------
    TransportError
        If an option is not accepted.
    MissionError, SettingError
        If the device cannot fly the mission.
    """
    address.check(
        ("device", "card", "hz", "seed", "rest", "over", "corruption", "jitter_ms", "drift_ppm", "mounted")
    )
    options = address.options
    mounted = options.get("mounted")
    encoder = make_encoder(options.get("device", "vectornav"))
    over = options.get("over")
    if over is not None and over.startswith("udp"):
        raise TransportError(f"{address}: over = {over!r}; accepted are pty and tcp:0")
    misbehaviour = Misbehaviour(
        address.number("corruption", 0.0, 0.0, _MAX_CORRUPTION),
        1e-3 * address.number("jitter_ms", 0.0, 0.0, _MAX_JITTER, "ms"),
        1e-6 * address.number("drift_ppm", 0.0, -_MAX_DRIFT, _MAX_DRIFT, "ppm"),
    )
    link = local_link() if over is None else make_link(over)
    flight = SimulatedFlight.of(
        address.place,
        address.number("hz", 100.0, *RATES, "Hz"),
        sensor=options.get("card", ""),
        seed=address.whole("seed", 1, 0, MAX_SEED),
        rest=address.number("rest", USUAL_REST if address.place == REST else 0.0, 0.0, _LONGEST_REST, "s"),
        axes=AxisMap.of(mounted) if mounted else None,
    )
    return SimulatedTransport(str(address), SimulatedDevice(flight, encoder, link, misbehaviour))
