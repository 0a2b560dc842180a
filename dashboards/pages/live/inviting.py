"""Inviting: shows the QR code for a phone, and waits until the phone has come."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn

from dashboards.phones import phone_server
from dashboards.style import wide_html
from lab.base.qr_code import qr_svg
from lab.live import open as open_source
from lab.live.phone.invitation import Invitation
from lab.live.phone.phone import INVITED
from lab.live.station import Station
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

LOOK = 500
"""Time between two looks whether the phone has come [ms]."""
AXES = "y,x,-z"
"""Forward is up the screen, right is right of it, and down is into it."""
LABEL = "QR code of the page for the phone"


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


def warning_svg() -> str:
    """Return a picture of the browser's warning on a phone: where to tap first, and where then."""
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" width="300" viewBox="0 0 300 230" role="img" '
        'aria-label="First tap Advanced, then Continue" font-family="system-ui, sans-serif" '
        'fill="currentColor">'
        + _phone(
            10, "1", "Advanced", '<text x="74" y="112" text-anchor="middle" font-size="11">Not private</text>'
        )
        + _phone(
            162, "2", "Continue",
            '<text x="226" y="112" text-anchor="middle" font-size="11">Continue to this</text>'
            '<text x="226" y="127" text-anchor="middle" font-size="11">address (unsafe)</text>',
        )
        + "</svg>"
    )  # fmt: skip


def invitation_html(invitation: Invitation) -> str:
    """Return the steps, the QR code and the picture as HTML; nothing in it was typed by a visitor."""
    steps = "".join(f"<li>{escape(step)}</li>" for step in invitation.steps)
    problem = (
        f'<p role="alert"><strong>{escape(invitation.problem)}</strong></p>' if invitation.problem else ""
    )
    address = escape(invitation.address)
    return (
        f"<div>{problem}<ol>{steps}</ol>"
        f'<div style="display:flex;flex-wrap:wrap;gap:24px;align-items:center">'
        f"{qr_svg(invitation.qr, LABEL)}{warning_svg()}</div>"
        f"<p>{escape(invitation.warning)}</p>"
        f'<p style="overflow-wrap:anywhere"><code>{address}</code></p></div>'
    )


def _phone(left: int, number: str, button: str, text: str) -> str:
    """Return a phone with a warning triangle, a text and a button that is marked."""
    middle = left + 64
    line = 'fill="none" stroke="currentColor" stroke-width="3"'
    centred = 'text-anchor="middle" font-weight="700"'
    right = left + 112
    return (
        f'<rect x="{left}" y="8" width="128" height="212" rx="16" {line}/>'
        f'<path d="M{middle} 40l26 44h-52z" stroke-linejoin="round" {line}/>'
        f'<text x="{middle}" y="78" font-size="22" {centred}>!</text>{text}'
        f'<rect x="{left + 14}" y="150" width="100" height="34" rx="8" fill="#0b57d0"/>'
        f'<text x="{middle}" y="172" font-size="14" fill="#fff" {centred}>{button}</text>'
        f'<circle cx="{right}" cy="150" r="12" fill="#b3261e"/>'
        f'<text x="{right}" y="155" font-size="14" fill="#fff" {centred}>{number}</text>'
    )
