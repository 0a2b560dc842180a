"""Wanted: how a page wants a device to be read and navigated with, beside how another page has opened it."""

from __future__ import annotations

from typing import NamedTuple

from lab.data.streams.address import Address
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.serial_port import BAUD
from lab.experiment.experiment import Experiment
from lab.live.station import Station

_ONE_READER = ("serial", "udp")
"""Kinds of devices that one program at a time may open, whatever the options."""
_COMPARED = ("baud", "protocol", "columns", "axes", "rate")
"""Options that say how a device is read."""


class Wanted(NamedTuple):
    """What a page wants of a device.

    Attributes
    ----------
    address : Address
        Its address, with all options.
    experiment : Experiment
        Its sensors and its navigator are those that the live navigator assumes.
    """

    address: Address
    experiment: Experiment

    def key(self, source: str) -> str:
        """Return the key of the station: a port has one, however it is written to be opened."""
        kind, place = self.address.kind, self.address.place
        return f"{kind}:{place}" if kind in _ONE_READER else source

    @property
    def is_alone(self) -> bool:
        """Whether only one at a time can read the device."""
        return self.address.kind in _ONE_READER

    def differences(self, station: Station) -> list[str]:
        """Return, in clauses, in what a station that is open differs from what is wanted."""
        usual = {"baud": str(BAUD)} if self.address.kind == "serial" else {}
        status = station.status
        there = usual | Address.of(station.source.address).options | {"axes": str(status.axes)}
        if status.protocol:
            there["protocol"] = status.protocol
        axes = self.address.options.get("axes", "" if self.address.kind == "replay" else str(AxisMap()))
        wanted = usual | self.address.options | ({"axes": str(AxisMap.of(axes))} if axes else {})
        clauses = [
            f"{name} is {there.get(name, 'to be found out')}, not {wanted[name]}"
            for name in _COMPARED
            if name in wanted and wanted[name] != there.get(name)
        ]
        if self.experiment.sensors.to_dict() != station.sensors.to_dict():
            clauses.append("the navigator assumes other sensors than your settings")
        if self.experiment.navigator.to_dict() != station.settings.to_dict():
            clauses.append("the navigator has other settings than yours")
        return clauses


def describe_difference(name: str, differences: list[str], others: int) -> str:
    """Return what a person is told whose device others have opened in another way."""
    pages = "one other page" if others == 1 else f"{others} other pages"
    return (
        f"{name} is open already on {pages}, but not as you chose: {'; '.join(differences)}. A device is "
        "read in one way for all. Press Connect to watch it as it is. To read it as you chose, have the "
        "others disconnect, choose it again, and connect."
    )
