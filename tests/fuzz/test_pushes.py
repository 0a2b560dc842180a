"""The short form of the attacks by phones: some hundred requests of each kind, the same ones every time."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

import numpy as np
import pytest
from pushes import PUSHES, START, STEP, attack_logger, besiege_phones, changed

ATTACKS = 300
REQUESTS = 60


@pytest.mark.parametrize("name", PUSHES)
def test_hostile_requests_are_refused_or_can_be_read_again(name):
    make, attack = PUSHES[name]
    good, rng = make(), np.random.default_rng(zlib.crc32(name.encode()))
    assert attack(good)
    taken = sum(attack(changed(good, rng)) for _ in range(ATTACKS))
    # Attacks that are all refused at the door would test nothing else.
    assert taken > ATTACKS // 20


def test_the_longest_numbers_fit_a_line():
    small = 1.2345678901234567e-100
    payload = [
        {"name": name, "time": START + 12_345_678_901 * one, "values": dict.fromkeys("xyz", -small)}
        for one in range(200)
        for name in ("gyroscope", "totalacceleration", "magnetometer")
    ]
    said = (
        "latitude", "longitude", "altitude", "horizontalAccuracy", "verticalAccuracy", "speed", "bearing",
        "speedAccuracy",
    )  # fmt: skip
    payload += [
        {"name": "location", "time": START + STEP * one, "values": dict.fromkeys(said, small)}
        for one in range(20)
    ]
    assert attack_logger(json.dumps({"deviceId": "an-identifier", "payload": payload}).encode())


def test_a_server_for_phones_holds_whatever_comes(tmp_path: Path) -> None:
    wrong: list[str] = []
    answers = besiege_phones(
        tmp_path,
        np.random.default_rng(11),
        lambda count: count >= REQUESTS,
        lambda what, sent: wrong.append(f"{what}: {sent[:200]!r}"),
    )
    assert wrong == []
    assert answers[200] > 0
    assert answers[400] > 0
