"""The invitation of a phone as a picture: well-formed text, and what is wrong."""

from __future__ import annotations

from lxml import etree

from dashboards.pages.live.inviting import invitation_html
from lab.base.qr_code import qr_code
from lab.live.phone.invitation import LOOPBACK, Invitation

ADDRESS = "https://192.0.2.1:5008/phone/abc"


def test_the_invitation_is_well_formed_and_says_what_is_wrong():
    good = Invitation(1, ADDRESS, "", qr_code(ADDRESS))
    html = etree.fromstring(invitation_html(good))
    text = "".join(html.itertext())
    assert ADDRESS in text
    assert good.warning in text
    assert "alert" not in invitation_html(good)
    assert LOOPBACK in invitation_html(Invitation(1, "<b>&", "", qr_code("x"), problem=LOOPBACK))
    assert "<b>" not in invitation_html(Invitation(1, "<b>&", "", qr_code("x")))
