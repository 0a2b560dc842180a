"""A phone in a real browser: its sensors are overridden, and what it streams arrives whole."""

from __future__ import annotations

import contextlib
import math
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_streams import decoded
from playwright.sync_api import Browser, BrowserContext, Page, Route, expect
from scipy.spatial.transform import Rotation

from lab.data.protocols.phone import PhoneDecoder
from lab.data.protocols.samples import Samples
from lab.live.phone.hub import PhoneHub, PhoneTransport
from lab.live.phone.server import PhoneServer
from tests.browser.conftest import HARMLESS, new_context

pytestmark = pytest.mark.browser

OUTAGE = float(os.environ.get("INS_LAB_OUTAGE", "3"))
"""Time without network [s]; the bar is 10 s, and the short form tests the same."""
SENSORS = ("accelerometer", "linear-acceleration", "gyroscope")
ALLOWED = ("accelerometer", "gyroscope", "magnetometer", "geolocation")
PLACE = {"latitude": -45.9, "longitude": 170.5, "accuracy": 12.0}


class Reader:
    """Reads a transport in a thread, as the live tab will."""

    def __init__(self, transport: PhoneTransport) -> None:
        self.data = bytearray()
        self._transport = transport
        self._over = threading.Event()
        transport.open()
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        with contextlib.suppress(EOFError):
            while not self._over.is_set():
                self.data += self._transport.read(0.1).data

    def stop(self) -> bytes:
        """Return what came."""
        self._over.set()
        self._thread.join()
        with contextlib.suppress(EOFError):  # what came after the last look
            while piece := self._transport.read(0.0).data:
                self.data += piece
        self._transport.close()
        return bytes(self.data)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PhoneServer]:
    with PhoneServer(PhoneHub(), folder=tmp_path) as server:
        yield server
        server.hub.forget_all()  # ends the readers of a test that failed


Opened = tuple[Page, Callable[[str, dict[str, Any]], Any], BrowserContext]


@pytest.fixture
def open_phone(chromium: Browser, complaints: list[str]) -> Iterator[Callable[..., Opened]]:
    """Return a function that opens an address as a phone with sensors does."""
    contexts = []

    def open_it(
        address: str, *, sensors: bool = True, allowed: tuple[str, ...] = ALLOWED, **options: Any
    ) -> Opened:
        context = new_context(
            chromium,
            viewport={"width": 390, "height": 844},
            is_mobile=True,
            has_touch=True,
            ignore_https_errors=True,
            permissions=list(allowed),
            geolocation=PLACE,
            **options,
        )
        contexts.append(context)
        page = context.new_page()
        tools = context.new_cdp_session(page)
        if sensors:
            for kind in SENSORS:
                metadata = {"available": True, "minimumFrequency": 1, "maximumFrequency": 100}
                tools.send(
                    "Emulation.setSensorOverrideEnabled",
                    {"enabled": True, "type": kind, "metadata": metadata},
                )
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda message: complaints.extend(blocked(message.text)))
        page.goto(address)
        return page, tools.send, context

    yield open_it
    for context in contexts:
        context.close()
    assert [text for text in complaints if not any(word in text for word in HARMLESS)] == []


def blocked(text: str) -> list[str]:
    """Return what a console says if the policy of the page blocked something; lost requests are expected."""
    return [text] if "Content Security Policy" in text or "Permissions policy" in text else []


def set_motion(send: Callable[..., Any], force: tuple[float, ...], rate: tuple[float, ...]) -> None:
    for kind, vector in (("accelerometer", force), ("linear-acceleration", (0, 0, 0)), ("gyroscope", rate)):
        reading = {"xyz": dict(zip("xyz", vector, strict=True))}
        send("Emulation.setSensorOverrideReadings", {"type": kind, "reading": reading})


def start(page: Page, name: str) -> None:
    page.get_by_label("Name shown on the computer").fill(name)
    page.get_by_role("button", name="Start").click()


def samples_of(data: bytes) -> Samples:
    decoder = PhoneDecoder()
    found = decoded(decoder, data)
    assert decoder.statistics.failed == decoder.statistics.skipped == decoder.statistics.refused == 0
    return found


def covered(data: bytes) -> float:
    """Return the time from the first sample to the last [s]."""
    found = samples_of(data).imu["time"]
    return float(np.ptp(found)) if found.size else 0.0


def wait_for(condition: Callable[[], bool], page: Page) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        page.wait_for_timeout(50)  # lets the browser's events through


def test_a_phone_streams_and_a_cut_of_the_network_loses_nothing(server, open_phone):
    ticket = server.hub.invite()
    page, send, context = open_phone(server.invitation(ticket).address)
    # A phone that stands upright and turns about its long side.
    send("DeviceOrientation.setDeviceOrientationOverride", {"alpha": 0, "beta": 90, "gamma": 0})
    set_motion(send, (0.0, 9.8, 0.0), (0.1, 0.2, 0.3))
    begun = time.monotonic()
    start(page, "Anna <b>")
    expect(page.get_by_text("Connected")).to_be_visible()
    wait_for(lambda: server.hub.phones()[0].samples > 0, page)
    assert server.hub.phones()[0].name == "Anna <b>"
    reader = Reader(server.hub.transport(ticket.key))
    expect(page.get_by_text("Recording")).to_be_visible()
    recording = time.monotonic()
    wait_for(lambda: covered(bytes(reader.data)) > 1.5, page)
    rate = samples_of(bytes(reader.data)).imu
    assert (len(rate) - 1) / np.ptp(rate["time"]) >= 50  # the bar

    # It turns by 30° to the left; the event of a browser that does not move comes once.
    send("DeviceOrientation.setDeviceOrientationOverride", {"alpha": 30, "beta": 90, "gamma": 0})
    wait_for(lambda: len(samples_of(bytes(reader.data)).reading) > 0, page)
    context.set_offline(True)
    expect(page.get_by_text("No network")).to_be_visible()
    set_motion(send, (0.0, 9.8, 1.0), (0.1, 0.2, 0.4))
    context.set_geolocation({**PLACE, "latitude": -45.8})
    page.wait_for_timeout(1000 * OUTAGE)
    silent = server.hub.phones()[0].silence
    assert silent > OUTAGE - 0.5
    context.set_offline(False)
    expect(page.get_by_text("Recording")).to_be_visible()
    shortest = time.monotonic() - recording
    page.get_by_role("button", name="Stop").click()
    expect(page.get_by_text(" 0 waiting")).to_be_visible()
    longest = time.monotonic() - begun
    count = int(page.locator("#count").inner_text().split()[0].replace(",", ""))
    wait_for(lambda: server.hub.phones()[0].samples == count, page)
    imu, fix, turned = samples_of(reader.stop())
    assert server.hub.phones()[0].lost == 0
    # Its top is up, its right side east but 30° to the left: north. In north, east, down:
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    found = Rotation.from_quat(turned["attitude"][-1], scalar_first=True).as_matrix()
    np.testing.assert_allclose(found, [[s, 0, -c], [c, 0, s], [0, -1, 0]], atol=1e-3)
    assert (np.diff(imu["count"]) == 1).all()
    assert imu["count"][-1] == count - 1
    assert np.diff(imu["time"]).min() > 0
    assert 0.9 * shortest < np.ptp(imu["time"]) < 1.2 * longest
    # Browsers round: to 0.1 °/s and 0.1 m/s².
    np.testing.assert_allclose(imu["rate"][:50], [[0.1, 0.2, 0.3]] * 50, atol=math.radians(0.06))
    np.testing.assert_allclose(imu["force"][:50], [[0, 9.8, 0]] * 50, atol=0.06)
    np.testing.assert_allclose(imu["rate"][-50:], [[0.1, 0.2, 0.4]] * 50, atol=math.radians(0.06))
    assert len(fix) >= 1
    assert math.degrees(fix["latitude"][-1]) == pytest.approx(-45.8)
    assert math.degrees(fix["longitude"][0]) == pytest.approx(PLACE["longitude"])
    # 95 % of two normal variables are within sqrt(5.991) σ (χ² with two degrees of freedom).
    assert fix["horizontal_sigma"][0] == pytest.approx(PLACE["accuracy"] / math.sqrt(5.991), rel=1e-3)


def test_what_is_too_old_is_dropped_and_counted(server, open_phone):
    ticket = server.hub.invite()
    address = server.invitation(ticket).address
    page, send, context = open_phone("about:blank")

    def with_a_short_memory(route: Route) -> None:
        reply = route.fetch()
        text = reply.text()
        assert "const KEPT = 60000;" in text
        # The policy allows the page's own script only, and this is another one.
        route.fulfill(
            body=text.replace("const KEPT = 60000;", "const KEPT = 1000;"), content_type="text/html"
        )

    page.route(address, with_a_short_memory)
    page.goto(address)
    set_motion(send, (0.0, 0.0, 9.8), (0, 0, 0))
    start(page, "Anna")
    wait_for(lambda: server.hub.phones()[0].samples > 0, page)
    reader = Reader(server.hub.transport(ticket.key))
    wait_for(lambda: len(reader.data) > 0, page)
    context.set_offline(True)
    expect(page.get_by_text("The network was away")).to_be_visible()
    context.set_offline(False)
    expect(page.get_by_text("Recording")).to_be_visible()
    page.get_by_role("button", name="Stop").click()
    expect(page.get_by_text(" 0 waiting")).to_be_visible()
    said = page.get_by_text("The network was away").inner_text()
    (lost,) = re.findall(r"(\d+) batches", said)
    assert int(lost) > 0
    wait_for(lambda: server.hub.phones()[0].lost == int(lost), page)
    imu = samples_of(reader.stop()).imu
    (gaps,) = np.nonzero(np.diff(imu["count"]) != 1)
    assert len(gaps) == 1
    assert np.diff(imu["time"])[gaps[0]] == pytest.approx(0.1 * int(lost), abs=0.25)


def test_a_phone_that_negates_is_found_by_its_own_attitude(server, open_phone):
    ticket = server.hub.invite()
    page, send, _ = open_phone(server.invitation(ticket).address)
    reader = Reader(server.hub.transport(ticket.key))
    # Lying on its left side, the right one up: the force of a phone that negates points down.
    send("DeviceOrientation.setDeviceOrientationOverride", {"alpha": 20, "beta": 0, "gamma": -89})
    set_motion(send, (-9.8, 0.0, 0.0), (0, 0, 0))
    start(page, "")
    wait_for(lambda: len(reader.data) > 3000, page)
    decoder = PhoneDecoder()
    imu = decoded(decoder, reader.stop()).imu
    np.testing.assert_allclose(imu["force"], [[9.8, 0, 0]] * len(imu), atol=0.06)
    assert "-9.8 m/s²" in decoder.evidence
    assert server.hub.phones()[0].name == f"Phone {ticket.key}"


def test_another_phone_with_the_same_address_is_refused(server, open_phone):
    ticket = server.hub.invite()
    address = server.invitation(ticket).address
    page, send, _ = open_phone(address)
    set_motion(send, (0, 0, 9.8), (0, 0, 0))
    start(page, "Anna")
    expect(page.get_by_text("Connected")).to_be_visible()
    page.reload()  # the same phone may come back
    start(page, "Anna")
    expect(page.get_by_text("Connected")).to_be_visible()
    other, _, _ = open_phone(address)
    start(other, "Mallory")
    expect(other.get_by_text("belongs to another phone")).to_be_visible()
    server.hub.forget(ticket.key)
    expect(page.get_by_text("Ask for a new QR code")).to_be_visible()


def test_what_is_missing_is_said(server, open_phone):
    page, _, _ = open_phone(
        server.invitation(server.hub.invite()).address, sensors=False, allowed=ALLOWED[:3]
    )
    start(page, "Anna")
    expect(page.get_by_text("This device gives no motion")).to_be_visible()
    expect(page.get_by_text("You refused the location")).to_be_visible()
    expect(page.get_by_text("No motion yet")).to_be_visible()


def test_a_refused_permission_is_said(server, open_phone):
    page, _, _ = open_phone(server.invitation(server.hub.invite()).address, allowed=())
    start(page, "Anna")
    expect(page.get_by_text("You refused motion")).to_be_visible()
    expect(page.get_by_text("You refused the location")).to_be_visible()
