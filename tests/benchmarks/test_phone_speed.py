"""Twenty phones at 60 Hz: nothing is lost, and the server with its decoders needs at most half a core."""

from __future__ import annotations

import http.client
import multiprocessing
import threading
import time
from multiprocessing.synchronize import Event
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from played_phone import JSON, batch, request, untrusting

from lab.data.protocols.phone import PhoneDecoder
from lab.data.protocols.samples import join_samples
from lab.live.phone.hub import PhoneHub
from lab.live.phone.server import PhoneServer

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(600)]

PHONES = 20
SECONDS = 20
BOUND = 0.5
"""Largest part of a core."""


def play(addresses: list[str], begin: Event) -> None:
    """Send 10 batches a second of 6 samples from each phone, as the page does, on connections that stay."""

    def one(number: int, address: str) -> None:
        at = urlsplit(address)
        connection = http.client.HTTPSConnection(str(at.hostname), at.port, timeout=30, context=untrusting())
        connection.connect()
        begin.wait()
        begun = time.monotonic() + 0.1 * number / PHONES
        for count in range(10 * SECONDS):
            time.sleep(max(begun + 0.1 * count - time.monotonic(), 0))
            body = request([batch(count)], device=f"phone-number-{number}")
            connection.request("POST", f"{at.path}/samples", body, JSON)
            answer = connection.getresponse()
            assert answer.status == 200, answer.read()
            answer.read()

    threads = [
        threading.Thread(target=one, args=(number, address)) for number, address in enumerate(addresses)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def test_twenty_phones(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    hub = PhoneHub()
    with PhoneServer(hub, folder=tmp_path) as server:
        tickets = [hub.invite() for _ in range(PHONES)]
        begin = context.Event()
        addresses = [server.invitation(ticket).address for ticket in tickets]
        phones = context.Process(target=play, args=(addresses, begin))
        transports = [hub.transport(ticket.key) for ticket in tickets]
        decoders = [PhoneDecoder() for _ in tickets]
        parts: list[list] = [[] for _ in tickets]
        for transport in transports:
            transport.open()
        phones.start()
        time.sleep(4)  # the process imports, and its phones shake hands
        spent, begun = time.process_time(), time.monotonic()
        begin.set()

        def read(number: int) -> None:
            while len(parts[number]) < 10 * SECONDS:
                data = transports[number].read(10).data
                assert data, "nothing came for 10 s"
                parts[number].append(decoders[number].feed(data))

        readers = [threading.Thread(target=read, args=(number,)) for number in range(PHONES)]
        for reader in readers:
            reader.start()
        for reader in readers:
            reader.join()
        part = (time.process_time() - spent) / (time.monotonic() - begun)
        phones.join(60)
        assert phones.exitcode == 0
    for found in parts:
        np.testing.assert_array_equal(join_samples(found).imu["count"], np.arange(60 * SECONDS))
    print(f"\n{PHONES} phones at 60 Hz: {100 * part:.0f} % of a core, with the decoders")
    assert part <= BOUND
