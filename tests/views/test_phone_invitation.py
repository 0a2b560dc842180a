"""The invitation of a phone as a picture: the QR code, drawn module by module, and well-formed text."""

from __future__ import annotations

import re

from lxml import etree

from lab.phone.invitation import LOOPBACK, Invitation, qr_code
from lab.views.phone_invitation import invitation_html, qr_svg

ADDRESS = "https://192.0.2.1:5008/phone/abc"


def test_the_qr_code_is_drawn_module_by_module():
    code = qr_code(ADDRESS)
    drawing = etree.fromstring(qr_svg(code))
    (path,) = drawing.iter("{*}path")
    dark = set()
    for x, y, length in re.findall(r"M(\d+) (\d+)h(\d+)v1h-\d+z", path.get("d")):
        dark |= {(int(y), int(x) + one) for one in range(int(length))}
    assert dark == {(y, x) for y, row in enumerate(code) for x, one in enumerate(row) if one}
    (paper,) = drawing.iter("{*}rect")
    assert (paper.get("fill"), path.get("fill")) == ("#fff", "#000")


def test_the_invitation_is_well_formed_and_says_what_is_wrong():
    good = Invitation(1, ADDRESS, "", qr_code(ADDRESS))
    html = etree.fromstring(invitation_html(good))
    text = "".join(html.itertext())
    assert ADDRESS in text
    assert good.warning in text
    assert "alert" not in invitation_html(good)
    assert LOOPBACK in invitation_html(Invitation(1, "<b>&", "", qr_code("x"), problem=LOOPBACK))
    assert "<b>" not in invitation_html(Invitation(1, "<b>&", "", qr_code("x")))
