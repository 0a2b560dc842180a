"""Phone invitation: the QR code for the owner of a phone, and a picture of the warning that follows."""

from __future__ import annotations

from html import escape

from lab.base.qr_code import qr_svg
from lab.live.phone.invitation import Invitation

LABEL = "QR code of the page for the phone"


def warning_svg(width: int = 300) -> str:
    """Return a picture of the browser's warning on a phone: where to tap first, and where then.

    Parameters
    ----------
    width
        Of the picture [px].
    """
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" viewBox="0 0 300 230" role="img" '
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
