"""X-Plane transport: simulated sensors in the aircraft of a running X-Plane, as one source of bytes."""

from __future__ import annotations

import time

from lab.base.parameters.counted import count_noun, was_or_were
from lab.data.protocols.decoder import Encoder
from lab.data.protocols.samples import Samples, join_samples
from lab.data.streams.address import MAX_SEED, Address, computer_and_port
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.transport import Chunk
from lab.data.streams.xplane_live import PORT, RATES, XPlaneLink
from lab.experiment.experiment import Experiment
from lab.live.simulated.simulated_device import make_encoder
from lab.live.simulated.simulated_flight import fix_rows, imu_rows
from lab.live.xplane.flight import XPlaneFlight
from lab.live.xplane.frames import BrokenFlightError
from lab.motion.truth.growing_truth import GrowingTruth
from lab.sensors.cards import card
from lab.sensors.sensor_stream import Sensed
from lab.sensors.suite import SensorSuite

SENSOR_RATES = (10.0, 1000.0)
"""Rates of simulated sensors in X-Plane [Hz]: the curve of its motion has its knots at this rate."""
_TOLD = 60.0
"""Time for which the reason of a new flight is told [s]: nobody looks at a page all the time."""
_MOST = 64
"""Most packets taken at once, before the samples go on: half a second at 50 Hz."""


class XPlaneTransport:
    """Asks X-Plane for its motion and sends what simulated sensors measure on it; a `Transport`.

    The bytes are those of a real device, and their arrival is the time of their last sample on the line of
    time of the flight: the simulator's clock, not the network, times them.

    Parameters
    ----------
    address
        The address it was opened by.
    link
        To X-Plane.
    flight
        The sensors, and what becomes of the packets.
    encoder
        The protocol of the device.
    axes
        How the device is mounted.
    """

    reconnects = True

    def __init__(
        self,
        address: str,
        link: XPlaneLink,
        flight: XPlaneFlight,
        encoder: Encoder,
        axes: AxisMap | None = None,
    ) -> None:
        self.address = address
        self._link = link
        self._flight = flight
        self._encoder = encoder
        self._axes = axes or AxisMap()
        self._why = ""  # the flight broke, which the next `read` reports
        self._broke: tuple[str, float] = ("", 0.0)  # why and when the flight last broke

    @property
    def truth(self) -> GrowingTruth:
        """The true motion of the aircraft."""
        return self._flight.truth

    @property
    def remark(self) -> str:
        """What comes from X-Plane, or why nothing does, in sentences; empty if there is nothing to say."""
        now, silence = time.monotonic(), self._link.silence
        found = [silence] if silence else []
        found += self._flight.frames.remarks(now)
        why, when = self._broke
        if why and now - when < _TOLD:
            found.insert(0, f"A new flight began {now - when:.0f} s ago, since {why}.")
        if foreign := self._link.foreign:
            found.append(f"{count_noun(foreign, 'packet')} from elsewhere {was_or_were(foreign)} not used.")
        return " ".join(found)

    def open(self) -> None:
        """Ask for the motion.

        Raises
        ------
        OSError
            If there is no such computer, or the network cannot be used.
        """
        self._link.open()
        self._flight.begin_anew()
        self._why = ""

    def read(self, longest: float) -> Chunk:
        """Wait for packets, and return the bytes that the sensors send by them.

        Raises
        ------
        OSError
            If the flight does not go on, as after a jump, or the network failed.
        """
        self._report()
        found: list[Samples] = []
        wait = longest
        for _ in range(_MOST):
            packet = self._link.packet(wait)
            if packet is None:
                break
            wait = 0.0
            try:
                found += [self._rows(one) for one in self._flight.accept(packet, time.monotonic())]
            except BrokenFlightError as why:
                self._why, self._broke = str(why), (str(why), time.monotonic())
                break
        now = time.monotonic()
        samples = join_samples(found)
        if not len(samples.imu):
            self._report()
            return Chunk(now, b"")
        latest = self._flight.epoch + float(samples.imu["time"][-1])
        return Chunk(latest, self._encoder.encode(samples.imu, samples.fix))

    def _rows(self, sensed: Sensed) -> Samples:
        rate = self._flight.rate
        triads = sensed.gyro.increments * rate, sensed.accelerometer.increments * rate
        return Samples(
            imu_rows(sensed.time, *triads, self._axes), fix_rows(sensed.fixes, self._flight.sensors.gps)
        )

    def _report(self) -> None:
        if self._why:
            raise ConnectionError(self._why)

    def close(self) -> None:
        """End the packets, and free the port; may be repeated."""
        self._link.close()


def open_xplane(address: Address) -> XPlaneTransport:
    """Return the simulated sensors in a running X-Plane of an address of the kind ``xplane``.

    Their errors are those of the laboratory's own sensors, or of the card that the address names.

    Raises
    ------
    TransportError
        If an option is not accepted.
    """
    experiment = Experiment(mission="montreal")
    if "card" in address.options:
        card(address.options["card"]).load(experiment)
    return xplane_transport(address, experiment.sensors)


def xplane_transport(address: Address, sensors: SensorSuite, seed: int = 1) -> XPlaneTransport:
    """Return simulated sensors in a running X-Plane.

    Parameters
    ----------
    address
        An address of the kind ``xplane``.
    sensors
        Their errors; a card in the address is not looked at.
    seed
        Of their random numbers, if the address gives none.

    Raises
    ------
    TransportError
        If an option is not accepted.
    """
    address.check(("card", "hz", "seed", "frames", "device", "mounted"))
    options = address.options
    place = address if ":" in address.place else Address(address.kind, f"{address.place}:{PORT}", options)
    encoder = make_encoder(options.get("device", "vectornav"))
    mounted = options.get("mounted")
    flight = XPlaneFlight(
        sensors,
        address.whole("seed", seed, 0, MAX_SEED),
        address.number("hz", 100.0, *SENSOR_RATES, "Hz"),
    )
    return XPlaneTransport(
        str(address),
        XPlaneLink(*computer_and_port(place), address.number("frames", 50.0, *RATES, "Hz")),
        flight,
        encoder,
        AxisMap.of(mounted) if mounted else None,
    )
