"""MAV type: the vehicles by the numbers that MAVLink, and the autopilots that speak it, have for them.

References
----------
MAVLink, *Common Message Set*, MAV_TYPE, https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from collections.abc import Mapping

VEHICLES: Mapping[float, str] = {
    1: "fixed wing", **dict.fromkeys((2, 3, 4, 13, 14, 15), "rotary wing"), 7: "airship", 8: "balloon",
    10: "rover", 11: "boat", 12: "submarine", **dict.fromkeys(range(19, 26), "vtol"),
}  # fmt: skip
"""Words for the vehicle, as of `lab.data.log.vehicle`, by the number."""
