"""The runways to start from, against what their source says of them besides: length and true heading."""

from __future__ import annotations

import numpy as np
import pymap3d.vincenty
import pytest

from lab.flying.airports import airport_names, runway, runways
from lab.missions import FlightPlan, MissionError

PUBLISHED = {
    "CYXY 14R": (158, 9497),
    "CYYC 17L": (180, 14000),
    "CYYT 11": (85.9, 8502),
    "CYYZ 05": (47, 11120),
    "CYZF 16": (176, 7500),
    "DAAG 05": (53, 11483),
    "DAAT 02": (22, 11811),
    "EGSC 05": (49.8, 6447),
    "EGSS 04": (44, 10003),
    "EGYP 10": (105, 8497),
    "EHAM 18R": (183, 12467),
    "YMAV 18": (187, 10000),
    "YMEN 08": (88, 6302),
}
"""True heading [°] and length [ft] of one direction of each, which the table does not hold."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_runway_lies_as_published(name: str) -> None:
    heading, feet = PUBLISHED[name]
    code, here = name.split(maxsplit=1)[0], runways()[name]
    (there,) = (end for other, end in runways().items() if other.startswith(code) and other != name)
    length, course = pymap3d.vincenty.vdist(
        here["latitude_deg"], here["longitude_deg"], there["latitude_deg"], there["longitude_deg"]
    )
    assert here["heading_deg"] == pytest.approx(float(course), abs=0.01)
    assert abs(np.remainder(here["heading_deg"] - heading + 180, 360) - 180) < 2.5
    assert abs(np.remainder(there["heading_deg"] - heading, 360) - 180) < 2.5
    assert float(length) == pytest.approx(feet * 0.3048, rel=0.04)


def test_every_airport_has_a_name_and_two_ends() -> None:
    assert {name.split()[0] for name in PUBLISHED} == set(airport_names())
    assert len(runways()) == 2 * len(PUBLISHED)


def test_a_plan_names_its_runway() -> None:
    values = {"runway": "egss  22", "duration_s": 30.0, "manoeuvres": [{"do": "take_off"}]}
    plan = FlightPlan.from_dict(values)
    assert plan.runway is not None
    assert plan.runway.latitude_deg == runway("EGSS 22")["latitude_deg"]
    assert FlightPlan.from_dict(plan.to_dict()) == plan
    with pytest.raises(MissionError, match=r"flight.runway: 'EGSS 2' is unknown. Did you mean EGSS 22\?"):
        FlightPlan.from_dict({**values, "runway": "EGSS 2"})
