"""Inviting: shows the QR code for a phone, and waits until the phone has come."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn

from dashboards.phones import phone_server
from dashboards.style import wide_html
from lab.live import open as open_source
from lab.live.phone.phone import INVITED
from lab.live.station import Station
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite
from lab.views.phone_invitation import invitation_html

LOOK = 500
"""Time between two looks whether the phone has come [ms]."""
AXES = "y,x,-z"
"""Forward is up the screen, right is right of it, and down is into it."""


class Inviting:
    """Invites one phone after the other.

    Attributes
    ----------
    view : panel.pane.HTML
        The invitation, visible while a phone is waited for.
    """

    def __init__(self) -> None:
        self._document = pn.state.curdoc
        self._key: int | None = None
        self._came: Callable[[int, str], None] = lambda _key, _name: None
        self._expired: Callable[[], None] = lambda: None
        self._looking: Any = None
        self.view = wide_html(visible=False, margin=(4, 10))

    @property
    def waiting(self) -> bool:
        """Whether a phone is waited for."""
        return self._key is not None

    def begin(self, came: Callable[[int, str], None], expired: Callable[[], None]) -> None:
        """Show an invitation.

        Parameters
        ----------
        came
            Called with number and name of the phone when it has come.
        expired
            Called if none has come in time.

        Raises
        ------
        TransportError
            If this server takes no phones, or too many are invited.
        """
        server = phone_server()
        ticket = server.hub.invite()
        self._key, self._came, self._expired = ticket.key, came, expired
        self.view.param.update(object=invitation_html(server.invitation(ticket)), visible=True)
        assert self._document is not None
        self._looking = self._document.add_periodic_callback(self._look, LOOK)

    def end(self) -> None:
        """Withdraw an invitation that nobody has used."""
        key = self._key
        self._stop()
        if key is not None:
            phone_server().hub.forget(key)

    def close(self) -> None:
        """As `end`, when the document is gone."""
        self._looking = None
        self.end()

    def _look(self) -> None:
        state = next((one for one in phone_server().hub.phones() if one.key == self._key), None)
        if state is None:
            self._stop()
            self._expired()
        elif state.state != INVITED:
            self._stop()
            self._came(state.key, state.name)

    def _stop(self) -> None:
        if self._looking is not None and self._document is not None:
            self._document.remove_periodic_callback(self._looking)
        self._key = self._looking = None
        self.view.visible = False


def forget_phone(key: int) -> None:
    """Tell a phone that nobody watches it any more: it cannot send, and says so."""
    phone_server().hub.forget(key)


def phone_station(key: int, name: str, sensors: SensorSuite, navigator: NavigatorSettings) -> Station:
    """Return the station of a phone that has come."""
    transport = phone_server().hub.transport(key)
    return Station(open_source(transport, protocol="phone", axes=AXES, name=name), sensors, navigator, name)
