"""Phones without a server: their states, their invitations, and the transport that reads them."""

from __future__ import annotations

import json
import math
import threading
import time

import numpy as np
import pytest
from live_streams import decoded
from played_phone import batch, request

from lab.data.protocols.phone import PhoneDecoder
from lab.data.streams.sensor_server import SensorServerTransport
from lab.data.streams.transport import Transport, TransportError
from lab.live.phone.hub import MOST, PhoneHub
from lab.live.phone.page_request import parse_page_request
from lab.live.phone.phone import Phone


def invited(hub: PhoneHub) -> tuple[int, Phone]:
    """Return a phone that was invited."""
    ticket = hub.invite()
    phone = hub.phone_of(ticket.token)
    assert phone is not None
    return ticket.key, phone


def send(hub: PhoneHub, phone: Phone, *numbers: int, **others) -> int:
    """Send batches as the server does; return the status."""
    posted = parse_page_request(request([batch(number) for number in numbers], **others))
    assert posted is not None
    assert hub.claim(phone, posted.device, posted.name)
    return phone.take_page_request(posted).status


def test_the_states_of_a_phone():
    now = [0.0]
    hub = PhoneHub(clock=lambda: now[0])
    key, phone = invited(hub)
    (state,) = hub.phones()
    assert (state.state, state.name, state.silence, state.left) == ("invited", "Phone 1", math.inf, 900)
    send(hub, phone, 0)
    assert hub.phones()[0].state == "connected"
    transport = hub.transport(key)
    transport.open()
    for number in range(1, 60):
        now[0] += 0.1
        send(hub, phone, number, waiting=3)
    (state,) = hub.phones()
    assert (state.state, state.name, state.source, state.samples, state.waiting) == (
        "streaming", "Anna", "page", 360, 3,
    )  # fmt: skip
    assert state.rate == pytest.approx(60, rel=0.03)
    now[0] += 3.1
    assert hub.phones()[0].state == "silent"
    transport.close()
    hub.forget(key)
    assert hub.phones() == []
    assert phone.state().state == "ended"
    assert not hub.claim(phone, "a-phone-of-a-test", "Anna")


def test_the_transports_are_what_they_promise_to_be():
    hub = PhoneHub()
    assert isinstance(hub.transport(invited(hub)[0]), Transport)
    assert isinstance(SensorServerTransport("sensorserver:192.0.2.1:8080"), Transport)


def test_each_chunk_is_a_request_with_its_arrival():
    now = [7.0]
    hub = PhoneHub(clock=lambda: now[0])
    key, phone = invited(hub)
    transport = hub.transport(key)
    transport.open()
    send(hub, phone, 0)
    now[0] = 7.5
    send(hub, phone, 1, 2)
    first, second = transport.read(0), transport.read(0)
    assert (first.arrival, second.arrival) == (7.0, 7.5)
    assert len(decoded(PhoneDecoder(), first.data).imu) == 6
    assert len(decoded(PhoneDecoder(), second.data).imu) == 12
    # Recorded bytes give the same rows, in whatever pieces they are read.
    whole = decoded(PhoneDecoder(), first.data + second.data, 7)
    np.testing.assert_array_equal(whole.imu["count"], np.arange(18))


def test_one_reader_at_a_time():
    hub = PhoneHub()
    key, phone = invited(hub)
    one, other = hub.transport(key), hub.transport(key)
    with pytest.raises(OSError, match="not open"):
        one.read(0)
    one.open()
    one.open()
    with pytest.raises(OSError, match="already"):
        other.open()
    other.close()
    send(hub, phone, 0)
    assert one.read(1).data
    one.close()
    one.close()
    other.open()
    assert other.read(0).data == b""
    with pytest.raises(TransportError, match="no phone 9"):
        hub.transport(9)


@pytest.mark.parametrize(("end", "error"), [("close", OSError), ("forget", EOFError)])
def test_a_waiting_read_ends(end, error):
    hub = PhoneHub()
    key, _ = invited(hub)
    transport = hub.transport(key)
    transport.open()
    raised = []

    def wait() -> None:
        try:
            transport.read(60)
        except (OSError, EOFError) as caught:
            raised.append(type(caught))

    thread = threading.Thread(target=wait)
    begun = time.monotonic()
    thread.start()
    transport.close() if end == "close" else hub.forget(key)
    thread.join(30)
    assert raised == [error]
    assert time.monotonic() - begun < 20


def test_what_was_received_before_the_end_is_still_read():
    hub = PhoneHub()
    key, phone = invited(hub)
    transport = hub.transport(key)
    transport.open()
    send(hub, phone, 0)
    hub.forget(key)
    assert transport.read(1).data
    with pytest.raises(EOFError):
        transport.read(1)


def test_invitations_are_bounded_and_their_tokens_differ():
    hub = PhoneHub()
    tokens = {hub.invite().token for _ in range(MOST)}
    assert len(tokens) == MOST
    assert min(map(len, tokens)) >= 43  # 256 bits
    with pytest.raises(TransportError, match="forget one"):
        hub.invite()
    hub.forget(1)
    hub.invite()
    hub.forget_all()
    assert hub.phones() == []
    assert all(hub.phone_of(token) is None for token in tokens)


def test_a_hub_keeps_no_token():
    hub = PhoneHub()
    ticket = hub.invite()
    assert ticket.token not in repr(vars(hub)) + "".join(repr(vars(one)) for one in hub._phones.values())


def test_heights_and_velocities_of_fixes():
    fix = [1000.0, 1.7e12, 45.0, 7.0, 300.0, 10.0, 5.0, 3.0, 90.0]
    still = [2000.0, 1.7e12, 45.0, 7.0, None, 10.0, None, 0.0, None]
    unknown = [3000.0, 1.7e12, 45.0, 7.0, None, 10.0, None, None, None]
    for apple in (False, True):
        posted = parse_page_request(request([batch(0, 0, fix=[fix, still, unknown])], apple=apple))
        assert posted is not None
        found = decoded(PhoneDecoder(), posted.batches[0].written()).fix
        assert found["sea_level"].tolist() == [apple] * 3
        assert found["fix_type"].tolist() == [3, 2, 2]
        assert found["velocity_n"][0][:2] == pytest.approx([0, 3], abs=1e-12)
        assert found["velocity_n"][1][:2].tolist() == [0, 0]
        assert np.isnan(found["velocity_n"][2]).all()
        # 95 % of a normal variable are within 1.96 σ.
        assert found["vertical_sigma"][0] == pytest.approx(5 / 1.96)
        assert found["time"].tolist() == [1.0, 2.0, 3.0]
    assert json.loads(posted.batches[0].written())["apple"] is True
