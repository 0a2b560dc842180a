"""The apps Sensor Logger and SensorServer: what their documents show is read, with signs and units."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from live_streams import decoded
from played_phone import JSON, Played, ask
from websockets.sync.server import serve

from lab.data.protocols.phone import PhoneDecoder
from lab.data.streams import sensor_server as sensor_server_module
from lab.data.streams.sensor_server import SensorServerTransport
from lab.data.streams.transport import TransportError
from lab.live.phone.hub import PhoneHub
from lab.live.phone.server import PhoneServer

START = 1698501144401773000
STEP = 10_000_000  # ns


@pytest.fixture
def played(tmp_path: Path) -> Iterator[Played]:
    with PhoneServer(PhoneHub(), folder=tmp_path, push_port=0) as server:
        yield Played(server)


def readings(kinds: dict[str, tuple[float, float, float]], count: int = 20, first: int = 0) -> list[dict]:
    """Return readings of sensors at 100 Hz, as PUSHING.md shows them."""
    return [
        {"name": name, "time": START + STEP * one, "values": dict(zip("xyz", values, strict=True))}
        for one in range(first, first + count)
        for name, values in kinds.items()
    ]


def message(payload: list, number: int = 0, device: str = "an-identifier") -> bytes:
    said = {"messageId": number, "sessionId": "identifier", "deviceId": device, "payload": payload}
    return json.dumps(said).encode()


def pushed(played: Played, *bodies: bytes, secure: bool = False) -> tuple[PhoneDecoder, object]:
    """Push messages and return the decoder and what it made of them."""
    transport = played.hub.transport(played.ticket.key)
    transport.open()
    address = played.push if not secure else played.page.replace("/phone/", "/push/")
    for body in bodies:
        assert ask(address, body, JSON).status == 200
    data = b""
    while chunk := transport.read(0.0).data:
        data += chunk
    decoder = PhoneDecoder()
    return decoder, decoded(decoder, data)


@pytest.mark.parametrize("secure", [False, True])
def test_android(played, secure):
    kinds = {
        "gyroscope": (0.1, 0.2, 0.3),
        "totalacceleration": (0.0, 1.0, 9.7),
        "accelerometer": (0.0, 0.1, 0.2),
        "gravity": (0.0, 0.9, 9.5),
        "magnetometer": (20.0, 0.0, -40.0),
    }
    location = {
        "latitude": 51.5, "longitude": -0.1, "altitude": 60.0, "horizontalAccuracy": 6.0,
        "verticalAccuracy": 3.0, "speed": 2.0, "bearing": 90.0, "speedAccuracy": 0.5,
    }  # fmt: skip
    fix = {"name": "location", "time": START + 5 * STEP, "values": location}
    battery = {"name": "battery", "time": START, "values": {"batteryLevel": 0.5}}
    decoder, (imu, fixes, _) = pushed(played, message([*readings(kinds), fix, battery]), secure=secure)
    assert len(imu) == 20
    np.testing.assert_allclose(np.diff(imu["time"]), 0.01, atol=1e-6)
    np.testing.assert_allclose(imu["rate"], [[0.1, 0.2, 0.3]] * 20)
    np.testing.assert_allclose(imu["force"], [[0.0, 1.0, 9.7]] * 20)
    assert not decoder.evidence.endswith("the lab negates it.")
    (row,) = fixes
    assert (math.degrees(row["latitude"]), math.degrees(row["longitude"])) == pytest.approx((51.5, -0.1))
    assert row["time"] - imu["time"][0] == pytest.approx(0.05, abs=1e-6)
    assert row["utc"] == pytest.approx(START / 1e9 + 0.05, abs=1e-5)
    assert row["velocity_n"][:2] == pytest.approx([0, 2], abs=1e-12)
    # UNITS.md: a radius of about one standard deviation; 68.3 % of two normal variables are within 1.515 σ.
    assert row["horizontal_sigma"] == pytest.approx(6 / 1.515, rel=1e-3)
    assert (row["height"], row["vertical_sigma"], row["speed_sigma"], row["sea_level"]) == (60, 3, 0.5, 0)


def test_an_iphone_sums_gravity_and_negates(played):
    # COORDINATES.md: all signs of acceleration and gravity are turned; those of the gyroscope are not.
    kinds = {"gyroscope": (0.1, 0, 0), "accelerometer": (0, -0.5, 0), "gravity": (0, -0.9, -9.76)}
    decoder, (imu, _, _) = pushed(played, message(readings(kinds)))
    np.testing.assert_allclose(imu["force"], [[0, 1.4, 9.76]] * 20)
    np.testing.assert_allclose(imu["rate"], [[0.1, 0, 0]] * 20)
    assert "negates it" in decoder.evidence


def test_what_is_pushed_twice_counts_once(played):
    kinds = {"gyroscope": (0.1, 0, 0), "totalacceleration": (0, 0, 9.8)}
    first, second = (message(readings(kinds, first=20 * one), one) for one in range(2))
    _, (imu, _, _) = pushed(played, first, first, second)
    assert len(imu) == 40
    assert np.diff(imu["time"]).min() > 0


def test_large_messages_are_split(played):
    kinds = {"gyroscope": (0.1, 0, 0), "totalacceleration": (0, 0, 9.8)}
    _, (imu, _, _) = pushed(played, message(readings(kinds, 1000)))
    assert len(imu) == 1000
    assert np.isfinite(imu["force"][:-1]).all()


def test_another_device_may_not_push(played):
    body = message(readings({"gyroscope": (0, 0, 0)}))
    assert ask(played.push, body, JSON).status == 200
    assert ask(played.push, message([], 1, "another-identifier"), JSON).status == 403
    assert ask(played.push[:-2], body, JSON).status == 403


@pytest.mark.parametrize(
    "payload",
    [
        [None, 1, "x", [], {}],
        [{"name": "gyroscope"}, {"name": ["gyroscope"], "time": START, "values": {}}],
        [{"name": "gyroscope", "time": 10**400, "values": {"x": 1, "y": 1, "z": 1}}],
        [{"name": "gyroscope", "time": True, "values": {"x": 1, "y": 1, "z": 1}}],
        [{"name": "gyroscope", "time": START, "values": {"x": "1", "y": 1, "z": 1}}],
        [{"name": "gyroscope", "time": START, "values": [1, 2, 3]}],
        [{"name": "location", "time": START, "values": {"latitude": 10**400, "speed": "x"}}],
    ],
)
def test_strange_readings_are_left_out(played, payload):
    _, (imu, fix, _) = pushed(played, message(payload))
    assert len(imu) == 0
    assert not np.isfinite(fix["latitude"]).any()


@contextmanager
def sensor_server(messages: list[str | bytes]) -> Iterator[tuple[str, list[str]]]:
    """Serve as the app does; give host and port, and the paths that were asked for."""
    paths: list[str] = []

    def handle(socket) -> None:
        paths.append(socket.request.path)
        for one in messages:
            socket.send(one)
        for _ in socket:  # until the client goes
            pass

    with serve(handle, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        host, port = server.socket.getsockname()
        try:
            yield f"{host}:{port}", paths
        finally:
            server.shutdown()
            thread.join()


def reading(kind: str, stamp: int, *values: float) -> str:
    said = {"type": f"android.sensor.{kind}", "timestamp": stamp, "values": values, "accuracy": 3}
    return json.dumps(said)


def test_sensor_server():
    start = 3925657519043709
    messages: list[str | bytes] = ["what is this", "[" * 5000, '{"timestamp":1}', b"\xff\x00"]
    for one in range(50):
        stamp = start + 5_000_000 * one
        messages += [
            reading("accelerometer", stamp, 0.3, -0.9, 9.75),
            reading("gyroscope", stamp + 1_000_000, 0.1, 0.2, 0.3),
            reading("light", stamp, 7.0, 0.0, 0.0),
        ]
    messages.append(reading("accelerometer", start + 250_000_000, 0.3, -0.9, 9.75))
    with sensor_server(messages) as (where, paths):
        transport = SensorServerTransport(f"sensorserver:{where}")
        transport.open()
        decoder, parts = PhoneDecoder(), []
        while sum(len(part.imu) for part in parts) < 50:
            chunk = transport.read(60.0)
            assert chunk.data
            parts.append(decoder.feed(chunk.data))
        assert transport.read(0.05).data == b""
        transport.close()
    imu = np.concatenate([part.imu for part in parts])
    np.testing.assert_allclose(imu["force"], [[0.3, -0.9, 9.75]] * len(imu), rtol=1e-12)
    np.testing.assert_allclose(imu["rate"], [[0.1, 0.2, 0.3]] * len(imu), rtol=1e-12)
    np.testing.assert_allclose(np.diff(imu["time"]), 0.005, atol=1e-6)
    asked = urlsplit(paths[0])
    assert asked.path == "/sensors/connect"
    assert "android.sensor.gyroscope" in json.loads(parse_qs(asked.query)["types"][0])


def test_readings_of_a_fiftieth_of_a_second_become_a_line(monkeypatch):
    """However many come, and however long a reader would wait."""
    now = [100.0]
    monkeypatch.setattr(sensor_server_module.time, "monotonic", lambda: now[0])

    class Steady:
        """Gives a reading every 4 ms; a reader that waits no longer gets none."""

        def recv(self, timeout: float) -> str:
            if timeout < 0.004:
                now[0] += timeout
                raise TimeoutError
            now[0] += 0.004
            return reading("gyroscope", round(now[0] * 1e9), 0.1, 0.2, 0.3)

    transport = SensorServerTransport("sensorserver:127.0.0.1:8080")
    monkeypatch.setattr(transport, "_socket", Steady())
    decoder, before = PhoneDecoder(), now[0]
    for line in range(1, 4):
        decoder.feed(transport.read(60.0).data)
        waited = now[0] - before
        assert waited == pytest.approx(line * (0.004 + 0.02), abs=1e-9)  # for the first, and for its company


def test_a_sensor_server_that_goes_is_lost_and_closing_ends_a_wait(monkeypatch):
    with sensor_server([]) as (where, _):
        transport = SensorServerTransport(f"sensorserver:{where}")
        transport.open()
        waits, failed = threading.Event(), threading.Event()
        receive = transport._socket.recv

        def receiving(timeout: float) -> str | bytes:
            waits.set()
            return receive(timeout)

        monkeypatch.setattr(transport._socket, "recv", receiving)

        def wait() -> None:
            with pytest.raises(OSError, match="gone"):
                transport.read(60)
            failed.set()

        thread = threading.Thread(target=wait)
        thread.start()
        assert waits.wait(60)
        transport.close()
        transport.close()
        thread.join(60)
        assert failed.is_set()
        with pytest.raises(OSError, match="not open"):
            transport.read(0)
    with pytest.raises(OSError, match="does not answer"):
        transport.open()


def test_a_message_that_is_too_large_ends_the_connection():
    with sensor_server(["x" * 20_000]) as (where, _):
        transport = SensorServerTransport(f"sensorserver:{where}")
        transport.open()
        with pytest.raises(OSError, match="gone"):
            transport.read(20)
        transport.close()


@pytest.mark.parametrize(
    "address", ["sensorserver:", "sensorserver:host", "sensorserver:h:0", "sensorserver:h:x", "ws:h:1"]
)
def test_addresses_of_another_form_are_refused(address):
    with pytest.raises(TransportError, match="accepted is sensorserver:HOST:PORT"):
        SensorServerTransport(address)
