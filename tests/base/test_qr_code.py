"""QR code: drawn module by module, and the text that was put in."""

from __future__ import annotations

import re

from lxml import etree

from lab.base.qr_code import qr_code, qr_svg

ADDRESS = "https://192.0.2.1:5008/phone/abc"


def test_the_qr_code_is_drawn_module_by_module():
    code = qr_code(ADDRESS)
    drawing = etree.fromstring(qr_svg(code, "A <code>"))
    (path,) = drawing.iter("{*}path")
    dark = set()
    for x, y, length in re.findall(r"M(\d+) (\d+)h(\d+)v1h-\d+z", path.get("d")):
        dark |= {(int(y), int(x) + one) for one in range(int(length))}
    assert dark == {(y, x) for y, row in enumerate(code) for x, one in enumerate(row) if one}
    (paper,) = drawing.iter("{*}rect")
    assert (paper.get("fill"), path.get("fill")) == ("#fff", "#000")
    assert drawing.get("aria-label") == "A <code>"
