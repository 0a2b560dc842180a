"""The phone server: who may send what, what is refused, and that nothing gets lost or stays behind."""

from __future__ import annotations

import contextlib
import json
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from http.client import HTTPSConnection
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import psutil
import pytest
from live_streams import decoded
from played_phone import JSON, Played, ask, batch, request, untrusting

from lab.data.protocols.phone import PhoneDecoder
from lab.live.phone import limits as limits_module
from lab.live.phone import server as server_module
from lab.live.phone.hub import PhoneHub
from lab.live.phone.limits import BODY, EACH
from lab.live.phone.server import PhoneServer


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PhoneServer]:
    """Return a server for this computer."""
    with PhoneServer(PhoneHub(), folder=tmp_path, push_port=0) as server:
        yield server


@pytest.fixture
def played(server: PhoneServer) -> Played:
    """Return a phone that was invited."""
    return Played(server)


def read_all(transport) -> bytes:
    data = b""
    while chunk := transport.read(0.0).data:
        data += chunk
    return data


def test_the_page_is_one_file_that_may_do_nothing_but_send(played):
    reply = ask(played.page)
    assert reply.status == 200
    policy = reply.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "connect-src 'self'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    text = reply.body.decode()
    assert "src=" not in text.replace("img-src", "")
    assert "://" not in text
    assert reply.headers["referrer-policy"] == "no-referrer"
    assert reply.headers["cache-control"] == "no-store"
    assert not {"set-cookie", "server", "etag", "access-control-allow-origin"} & reply.headers.keys()


def test_batches_arrive_in_order_whatever_is_resent(played):
    transport = played.hub.transport(played.ticket.key)
    transport.open()
    assert played.post(batch(0), batch(1)).said["received"] == 1
    assert played.post(batch(1), batch(2)).said["received"] == 2  # the answer was lost on the way
    assert played.post(batch(4)).said["received"] == 2  # a batch is missing
    assert played.post(batch(3), batch(4)).said == {
        "received": 4, "read": True, "name": "Anna", "reason": "",
    }  # fmt: skip
    imu = decoded(PhoneDecoder(), read_all(transport)).imu
    assert imu["count"].tolist() == list(range(30))
    np.testing.assert_allclose(np.diff(imu["time"]), 1 / 60, atol=2e-6)
    np.testing.assert_allclose(imu["rate"], np.radians([[0.1, -0.2, 0.3]] * 30))
    np.testing.assert_allclose(imu["force"], [[0.0, 0.1, 9.8]] * 30)


def test_a_page_that_was_loaded_again_goes_on(played):
    transport = played.hub.transport(played.ticket.key)
    transport.open()
    played.post(batch(0))
    assert played.post(batch(0), run=2, origin=1.7e12 + 5000).said["received"] == 0
    assert played.post(batch(1)).status == 409  # the old page, in another tab
    imu = decoded(PhoneDecoder(), read_all(transport)).imu
    assert len(imu) == 12
    assert imu["time"][6] - imu["time"][0] == pytest.approx(5.0)


def test_what_the_phone_dropped_is_counted(played):
    played.post(batch(0))
    assert played.post(batch(7), oldest=7).said["received"] == 7
    assert played.hub.phones()[0].lost == 6


def test_nobody_reads_yet(played):
    reply = played.post(batch(0))
    assert (reply.said["read"], reply.said["received"]) == (False, 0)
    transport = played.hub.transport(played.ticket.key)
    transport.open()
    assert transport.read(0.0).data == b""
    assert played.hub.phones()[0].samples == 6


def test_wrong_old_and_foreign_tokens_are_refused(server):
    played = Played(server)
    assert played.post(batch(0)).status == 200
    assert played.post(batch(1), device="another-phone").status == 403
    wrong = played.page[:-1] + ("A" if played.page[-1] != "A" else "B")
    for address in (wrong, f"{wrong}/samples", played.page + "x"):
        body = None if address != f"{wrong}/samples" else request([batch(0)])
        reply = ask(address, body, JSON)
        assert reply.status == 403
        assert played.ticket.token not in reply.body.decode()
    other = Played(server)
    assert other.post(batch(0), device="another-phone").status == 200
    server.hub.forget(played.ticket.key)
    assert played.post(batch(1)).status == 403
    assert ask(played.page).status == 403
    assert other.post(batch(1), device="another-phone").status == 200


def test_invitations_expire(tmp_path):
    now = [0.0]
    hub = PhoneHub(unused=60, lifetime=600, clock=lambda: now[0])
    with PhoneServer(hub, folder=tmp_path) as server:
        used, unused = Played(server), Played(server)
        used.post(batch(0))
        now[0] = 61.0
        assert ask(unused.page).status == 403
        assert unused.post(batch(0)).status == 403
        assert used.post(batch(1)).status == 200
        transport = hub.transport(used.ticket.key)
        transport.open()
        now[0] = 601.0
        assert used.post(batch(2)).status == 403
        assert hub.phones() == []
        with pytest.raises(EOFError, match="invitation is over"):
            transport.read(5)


def test_nothing_else_is_served(played, server):
    root = played.page.rsplit("/phone/", 1)[0]
    token = played.ticket.token
    paths = ["/", "/phone", "/phone/", "/static/x", "/favicon.ico", "/push/"]
    page = f"/phone/{token}"
    for path in (*paths, f"{page}/", f"{page}/samples/x", f"/phone/..{page}/x", f"{page}/samples%00"):
        assert ask(root + path).status == 404, path
    for method in ("PUT", "DELETE", "OPTIONS", "PATCH", "HEAD"):
        reply = ask(f"{played.page}/samples", b"", JSON, method)
        assert reply.status == 405
        assert "access-control-allow-origin" not in reply.headers
    plain = f"http://127.0.0.1:{server.push_port}"
    assert ask(f"{plain}/phone/{token}").status == 404
    assert ask(f"{plain}/phone/{token}/samples", request([batch(0)]), JSON).status == 404


def eventually(condition: Callable[[], bool]) -> bool:
    """Return whether a condition comes true within 20 s; a connection that is closed does not count."""
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        with contextlib.suppress(OSError):
            if condition():
                return True
    return False


def test_other_sites_may_not_send(played):
    address = f"{played.page}/samples"
    body = request([batch(0)])
    assert ask(address, body, {**JSON, "Origin": "https://elsewhere.example"}).status == 403
    assert ask(address, body, {**JSON, "Origin": "null"}).status == 403
    assert ask(address, body, {"Content-Type": "text/plain"}).status == 415
    assert played.hub.phones()[0].state == "invited"
    assert ask(address, body, {**JSON, "Origin": played.page.rsplit("/phone/", 1)[0]}).status == 200


def test_too_large_bodies_are_refused(played):
    assert ask(f"{played.page}/samples", b" " * (BODY + 1), JSON).status == 413
    assert ask(f"{played.page}/samples", b" " * BODY, JSON).status == 400


def test_too_many_requests_are_refused(tmp_path):
    now = [0.0]
    with PhoneServer(PhoneHub(clock=lambda: now[0]), folder=tmp_path) as server:
        played, other = Played(server), Played(server)
        replies = [played.post() for _ in range(61)]
        assert [reply.status for reply in replies] == [200] * 60 + [429]
        assert int(replies[-1].headers["retry-after"]) == 1
        assert other.post(device="another-phone").status == 200
        now[0] += 1.01
        assert [played.post().status for _ in range(31)] == [200] * 30 + [429]


def test_too_many_samples_a_second_are_refused_and_come_later(tmp_path, monkeypatch):
    monkeypatch.setattr("lab.live.phone.phone.SAMPLE_BURST", 2500)
    now = [0.0]
    with PhoneServer(PhoneHub(clock=lambda: now[0]), folder=tmp_path) as server:
        played = Played(server)
        batches = [batch(one, 200) for one in range(15)]
        assert played.post(*batches[:12]).said["received"] == 11
        assert played.post(*batches[12:]).status == 429
        now[0] += 0.4
        assert played.post(*batches[12:]).status == 429
        now[0] += 0.2  # 700 samples at 1000 a second, with the 100 that were left
        assert played.post(*batches[12:]).said["received"] == 14


def test_a_reader_that_is_too_slow_makes_the_phone_wait(played, monkeypatch):
    monkeypatch.setattr("lab.live.phone.phone.QUEUE", 3000)
    transport = played.hub.transport(played.ticket.key)
    transport.open()
    number = 0
    while (reply := played.post(batch(number))).status == 200:
        number += 1
    assert reply.status == 503
    assert reply.said["received"] == number - 1
    data = read_all(transport)
    assert played.post(batch(number)).said["received"] == number
    imu = decoded(PhoneDecoder(), data + read_all(transport)).imu
    assert imu["count"].tolist() == list(range(6 * (number + 1)))


HOSTILE = {
    "nothing": b"",
    "deep": b"[" * 100_000,
    "deep object": b'{"a":' * 40_000,
    "huge whole number": b'{"run":' + b"9" * 200_000 + b"}",
    "whole number beyond floats": request([]).replace(b'"run": 1', b'"run": ' + b"9" * 4000),
    "NaN": request([batch(0)]).replace(b"9.8", b"NaN"),
    "infinity": request([batch(0)]).replace(b"9.8", b"1e999"),
    "no UTF-8": b"\xff\xfe" * 100,
    "text for numbers": request([batch(0, imu=[["1", 2, 3, 4, 5, 6, 7]])]),
    "booleans": request([batch(0, imu=[[True, 2, 3, 4, 5, 6, 7]])]),
    "no time": request([batch(0, imu=[[None, 2, 3, 4, 5, 6, 7]])]),
    "short rows": request([batch(0, imu=[[1, 2, 3]])]),
    "rows of rows": request([batch(0, imu=[[[1]] * 7])]),
    "too many rows": request([batch(0, 201)]),
    "too many batches": request([batch(one, 0) for one in range(101)]),
    "disorder": request([batch(1), batch(0)]),
    "negative number": request([batch(-1)]),
    "batches of text": request([]).replace(b"[]", b'"abc"'),
    "a list": json.dumps([1, 2]).encode(),
    "no device": request([], device=""),
    "long device": request([], device="x" * 65),
    "device of another kind": request([], device={"a": 1}),
    "name of another kind": request([], name=["Anna"]),
    "many names": json.dumps({str(one): one for one in range(15_000)}).encode(),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_json_is_refused_quickly(played, kind):
    begun = time.process_time()  # the server is in this process, and others make it wait
    assert ask(f"{played.page}/samples", HOSTILE[kind], JSON).status == 400
    assert ask(f"{played.push}", HOSTILE[kind], JSON).status == 400
    assert time.process_time() - begun < 5
    assert played.hub.phones()[0].state == "invited"
    assert played.post(batch(0)).status == 200


@pytest.mark.parametrize(
    ("typed", "shown"),
    [
        ("  Anna \n B. ", "Anna B."),
        ("<img src=x onerror=alert(1)>", "<img src=x onerror=alert(1)>"),
        ("x" * 5000, "x" * 40),
        ("a\u202eb\x00\u200bc", "a b c"),
        ("\u200b \x07", "Phone 1"),
        ("\ud800", "Phone 1"),
    ],
)
def test_names_are_plain_short_text(played, typed, shown):
    assert played.post(name=typed).said["name"] == shown
    assert played.hub.phones()[0].name == shown


def test_two_phones_of_one_name_are_told_apart(server):
    names = [Played(server).post(device=f"phone-number-{one}").said["name"] for one in range(3)]
    assert names == ["Anna", "Anna (2)", "Anna (3)"]
    assert server.hub.transport(3).address == "phone:Anna (3)"


def test_slow_connections_are_closed_and_others_served(tmp_path, monkeypatch):
    monkeypatch.setattr(server_module, "IDLE", 0.5)
    monkeypatch.setattr(server_module, "SLOW", 0.5)
    with PhoneServer(PhoneHub(), folder=tmp_path) as server:
        played = Played(server)
        where = ("127.0.0.1", server.port)
        silent = [socket.create_connection(where, 10) for _ in range(5)]  # no handshake
        slow = [untrusting().wrap_socket(socket.create_connection(where, 10)) for _ in range(4)]
        path = played.page.rsplit(str(server.port), 1)[1]
        head = f"POST {path}/samples HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
        slow[0].sendall(b"GET")
        slow[1].sendall(head.encode())
        slow[2].sendall(f"{head}Content-Length: 5000\r\n\r\n{{".encode())
        slow[3].sendall(f"{head}Transfer-Encoding: chunked\r\n\r\n5\r\n".encode())
        assert played.post(batch(0)).status == 200  # others do not wait
        for one in (*silent, *slow):
            while one.recv(1000):  # times out, and fails, unless the server closes
                pass
            one.close()
        assert played.post(batch(1)).status == 200


def is_closed(connection: socket.socket) -> bool:
    """Return whether the server has closed a connection on which it has nothing to say."""
    connection.settimeout(0.1)
    try:
        return connection.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True
    finally:
        connection.settimeout(20)


@pytest.mark.parametrize("bound", ["MOST", "STRANGERS"])
def test_where_strangers_hold_too_many_connections_the_oldest_makes_room(tmp_path, monkeypatch, bound):
    monkeypatch.setattr(limits_module, bound, 3)
    with PhoneServer(PhoneHub(), folder=tmp_path) as server:
        played = Played(server)
        where = ("127.0.0.1", server.port)
        held = [socket.create_connection(where, 10) for _ in range(4)]
        assert eventually(lambda: is_closed(held[0]))
        assert not any(is_closed(one) for one in held[1:])
        assert played.post(batch(0)).status == 200  # a phone that comes is not kept out
        assert eventually(lambda: is_closed(held[1]))
        for one in held:
            one.close()


def test_one_phone_has_four_connections_and_keeps_no_other_out(tmp_path, monkeypatch):
    monkeypatch.setattr(limits_module, "MOST", 6)
    with PhoneServer(PhoneHub(), folder=tmp_path) as server:
        greedy, other = Played(server), Played(server)
        held = []
        for _ in range(12):
            one = HTTPSConnection("127.0.0.1", server.port, timeout=20, context=untrusting())
            held.append(one)
            assert gives_page(one, greedy)
            assert other.post(batch(0)).status == 200
        assert eventually(lambda: all(is_closed(one.sock) for one in held[:-EACH]))
        for one in held:
            one.auto_open = 0  # not a new connection in place of one that is closed
        assert all(gives_page(one, greedy) for one in held[-EACH:])
        for one in held:
            one.close()


def gives_page(connection: HTTPSConnection, phone: Played) -> bool:
    """Return whether a phone is given its page by a connection, which stays open."""
    connection.request("GET", urlsplit(phone.page).path)
    answer = connection.getresponse()
    return answer.status == 200 and len(answer.read()) > 1000


@pytest.mark.parametrize("origin", ["http://[", "http://[::1", "[", "://", "http://a:b:c", "\xff", ""])
def test_an_origin_that_is_none_is_refused_in_words(played, origin):
    reply = ask(f"{played.page}/samples", json.dumps(batch(0)).encode(), {**JSON, "Origin": origin})
    assert reply.status == 403
    assert b"belongs to another phone" in reply.body


def test_closing_leaves_nothing_behind(tmp_path):
    process = psutil.Process()
    fds, threads = process.num_fds(), set(threading.enumerate())
    for _ in range(3):
        server = PhoneServer(PhoneHub(), folder=tmp_path, push_port=0)
        server.open()
        port = server.port
        open_one = untrusting().wrap_socket(socket.create_connection(("127.0.0.1", port), 10))
        waiting = socket.create_connection(("127.0.0.1", port), 10)
        open_one.sendall(b"GET / HTTP/1.1\r\n")
        assert Played(server).post(batch(0)).status == 200
        server.close()
        server.close()
        assert open_one.recv(1) == b""
        open_one.close()
        waiting.close()
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(("127.0.0.1", port), 10)
        again = PhoneServer(PhoneHub(), port=port, folder=tmp_path)
        again.open()
        again.close()
    assert process.num_fds() <= fds  # fewer, if something of an earlier test ended late
    assert set(threading.enumerate()) <= threads


def test_a_port_that_is_taken_says_so_and_leaves_nothing(tmp_path, server):
    process = psutil.Process()
    before = process.num_fds()
    with pytest.raises(OSError, match="in use"):
        PhoneServer(PhoneHub(), port=0, push_port=server.port, folder=tmp_path).open()
    assert process.num_fds() == before


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_old_tls_is_refused(server):
    context = untrusting()
    context.minimum_version = ssl.TLSVersion.TLSv1
    context.maximum_version = ssl.TLSVersion.TLSv1_1
    context.set_ciphers("ALL:@SECLEVEL=0")
    with socket.create_connection(("127.0.0.1", server.port), 10) as plain, pytest.raises(ssl.SSLError):
        context.wrap_socket(plain)
    for version in (ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3):
        context = untrusting()
        context.minimum_version = context.maximum_version = version
        with socket.create_connection(("127.0.0.1", server.port), 10) as plain, context.wrap_socket(plain):
            pass


def test_twenty_phones_at_once_lose_nothing(server):
    phones = [Played(server) for _ in range(20)]
    transports = [server.hub.transport(phone.ticket.key) for phone in phones]
    for transport in transports:
        transport.open()
    errors = []

    def send(phone: Played) -> None:
        for number in range(10):
            reply = phone.post(batch(number), device=f"phone-number-{phone.ticket.key}")
            if (reply.status, reply.said["received"]) != (200, number):
                errors.append(reply)

    threads = [threading.Thread(target=send, args=(phone,)) for phone in phones]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    for transport in transports:
        imu = decoded(PhoneDecoder(), read_all(transport)).imu
        assert imu["count"].tolist() == list(range(60))
        transport.close()
