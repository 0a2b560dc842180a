"""Front: several processes behind one port; each connection goes to the process that its request belongs to.

A process gets the connection itself (`socket.send_fds`): browsers talk to it as if there were no other,
nothing is copied, and no header has to be believed. The head of a request says what it belongs to, and stays
to be read: by the signature of a page's token, a class or the page Live in the address, the number in the
address of a 3-D view, or the random cookie of the browser. A process that has ended is started again.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import re
import secrets
import signal
import socket
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any
from urllib.parse import parse_qs, urlsplit

from bokeh.util.token import check_token_signature
from tornado.netutil import bind_sockets

from dashboards.process_place import STREAMS
from dashboards.worker import READY, Part, work

MOST_HEAD = 2**16
"""Longest head of a request [bytes], as in Tornado."""
PATIENCE = 60.0
"""Longest wait for the head of a request [s]: browsers open connections before they need them."""
PIECES = 0.02
"""Time between two looks at a head of which a part has come [s]."""
MOST_WAITING = 1000
"""Most connections whose head has not come; more are closed at once, so that handles remain for visitors."""
ENDING = 10.0
"""Longest time for the processes to part from their pages [s]."""
STEADY = 30.0
"""Time after which a process that ends is started at once [s]; before, it waits, longer each time."""
LONGEST = 30.0
"""Longest wait before a process is started again [s]."""

_LATER = (
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/html; charset=utf-8\r\nRefresh: 2\r\n"
    b"Cache-Control: no-store\r\nConnection: close\r\n\r\n"
    b"<!DOCTYPE html><title>INS Lab</title><p>The laboratory is about to start.</p>"
)
"""Answer for a process that is about to start; browsers ask again by themselves."""
_VIEW = re.compile(r".*/viser/(\d{1,4})\.")
_BROWSER = re.compile(r"\bins_lab_browser(?:_\d+)?=([\w-]{43})", re.ASCII)
_TEACHER = re.compile(r"\bins_lab_teacher(?:_\d+)?=", re.ASCII)


def choose_process(head: bytes, keys: Sequence[bytes]) -> int | None:
    """Return the number of the process to which a request belongs; None if any will do.

    Parameters
    ----------
    head
        The beginning of the request, which may be anything.
    keys
        Secret keys of the processes, in their order, with which they sign the tokens of their pages.
    """
    lines = head.partition(b"\r\n\r\n")[0].decode("latin-1").split("\r\n")
    _, target, *_ = [*lines[0].split(" "), "", ""]
    headers = dict[str, str]()
    for line in lines[1:]:
        name, _, value = line.partition(":")
        headers[name.strip().lower()] = value.strip()
    try:
        address = urlsplit(target)
        asked = parse_qs(address.query, max_num_fields=1000)
    except ValueError:
        return None
    if address.path.endswith("/ws"):
        return _signer(headers.get("sec-websocket-protocol", ""), keys)
    if view := _VIEW.match(address.path):
        return int(view[1]) if int(view[1]) < len(keys) else None
    cookies = headers.get("cookie", "")
    is_of_first = "class" in asked or STREAMS in asked.get("tab", ()) or _TEACHER.search(cookies)
    if is_of_first or address.path.endswith(("/teach", "/login")):
        return 0
    browser = _BROWSER.search(cookies)
    # A checksum, since `hash` of a text differs from process to process.
    return zlib.crc32(browser[1].encode()) % len(keys) if browser else None


def _signer(offered: str, keys: Sequence[bytes]) -> int | None:
    token = offered.rpartition(",")[2].strip()
    for number, key in enumerate(keys):
        with contextlib.suppress(Exception):  # a token that is none, in any way
            if check_token_signature(token, key, True):
                return number
    return None


@dataclass
class Worker:
    """One of the processes, as the front sees it.

    Attributes
    ----------
    process : multiprocessing.Process
        The process.
    channel : socket.socket
        Takes connections to it, and says when it is ready.
    key : bytes
        Its secret key.
    begun : float
        When it was started [s].
    is_ready : bool
        Whether it takes connections.
    """

    process: Any
    channel: socket.socket
    key: bytes
    begun: float
    is_ready: bool = False


@dataclass
class Front:
    """The front of some processes.

    Parameters
    ----------
    parts
        What each process serves.
    greeting
        Printed once all processes take visitors.
    opened
        Called then.
    """

    parts: Sequence[Part]
    greeting: str
    opened: Callable[[], None]
    _workers: list[Worker] = field(default_factory=list)
    _turns: Iterator[int] = field(default_factory=itertools.count)
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)
    _failures: dict[int, int] = field(default_factory=dict)
    _greeted: bool = False
    _ends: bool = False

    async def run(self, listening: Sequence[socket.socket]) -> int:
        """Serve until a signal comes; return its number.

        Parameters
        ----------
        listening
            The sockets of the port.
        """
        loop = asyncio.get_running_loop()
        asked = loop.create_future()

        def end(number: int) -> None:
            if not asked.done():
                asked.set_result(number)

        for name in ("SIGTERM", "SIGHUP", "SIGINT"):
            number = getattr(signal, name)
            loop.add_signal_handler(number, end, number)
        self._workers = [self._start_process(part) for part in self.parts]
        for one in listening:
            loop.add_reader(one.fileno(), self._accept, one)
        try:
            return int(await asked)
        finally:
            self._ends = True
            for one in listening:
                loop.remove_reader(one.fileno())
                one.close()
            for worker in self._workers:
                with contextlib.suppress(ProcessLookupError):
                    worker.process.terminate()
            for worker in self._workers:
                await asyncio.to_thread(worker.process.join, ENDING)
                if worker.process.is_alive():
                    worker.process.kill()

    def _start_process(self, part: Part) -> Worker:
        """Start a process, and follow what becomes of it."""
        loop = asyncio.get_running_loop()
        ours, theirs = socket.socketpair()
        ours.setblocking(False)
        key = secrets.token_bytes(32)
        process = get_context("spawn").Process(target=work, args=(part, key, theirs), daemon=True)
        process.start()
        # Only the process has this end now, so that its death shows at ours.
        theirs.close()
        worker = Worker(process, ours, key, loop.time())
        loop.add_reader(ours.fileno(), self._read_messages, worker)
        loop.add_reader(process.sentinel, self._restart_process, part, worker)
        return worker

    def _read_messages(self, worker: Worker) -> None:
        try:
            said = worker.channel.recv(1)
        except BlockingIOError:
            return
        except OSError:
            said = b""
        if said != READY:
            asyncio.get_running_loop().remove_reader(worker.channel.fileno())
            return
        worker.is_ready = True
        if not self._greeted and all(one.is_ready for one in self._workers):
            self._greeted = True
            print(self.greeting, flush=True)
            self.opened()

    def _restart_process(self, part: Part, worker: Worker) -> None:
        """Start a process again that has ended by itself."""
        loop = asyncio.get_running_loop()
        loop.remove_reader(worker.process.sentinel)
        loop.remove_reader(worker.channel.fileno())
        worker.is_ready = False
        worker.channel.close()
        if self._ends:
            return
        steady = loop.time() - worker.begun >= STEADY
        failures = 0 if steady else self._failures.get(part.number, 0) + 1
        self._failures[part.number] = failures
        wait = min(2.0**failures, LONGEST) if failures else 0.0
        said = f"process {part.number + 1} of {len(self.parts)} has ended and is started again in {wait:g} s"
        print(f"ins-lab: {said}", file=sys.stderr, flush=True)
        loop.call_later(wait, self._start_again, part)

    def _start_again(self, part: Part) -> None:
        if not self._ends:
            self._workers[part.number] = self._start_process(part)

    def _accept(self, listening: socket.socket) -> None:
        with contextlib.suppress(OSError):  # none is there any more, or the system has no more room
            connection, _ = listening.accept()
            if len(self._tasks) >= MOST_WAITING:
                connection.close()
                return
            connection.setblocking(False)
            task = asyncio.get_running_loop().create_task(self._hand_over(connection))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _hand_over(self, connection: socket.socket) -> None:
        """Give a connection to its process once the head of its request is there."""
        with connection, contextlib.suppress(OSError, TimeoutError):
            head = await asyncio.wait_for(_head(connection), PATIENCE)
            if not head:
                return
            place = choose_process(head, [one.key for one in self._workers])
            if place is None:
                ready = [number for number, one in enumerate(self._workers) if one.is_ready]
                place = ready[next(self._turns) % len(ready)] if ready else 0
            worker = self._workers[place]
            while worker.is_ready:
                try:
                    # A handle travels beside a byte at least.
                    socket.send_fds(worker.channel, [b"."], [connection.fileno()])
                except BlockingIOError:
                    await asyncio.sleep(PIECES)
                else:
                    return
            # A closed connection with unread bytes is reset, and the answer lost: they are read before.
            connection.recv(MOST_HEAD)
            connection.send(_LATER)


async def _head(connection: socket.socket) -> bytes:
    """Return the head of a request, which stays to be read; empty if there will be none."""
    loop = asyncio.get_running_loop()
    seen = -1
    while True:
        try:
            head = connection.recv(MOST_HEAD, socket.MSG_PEEK)
        except BlockingIOError:
            there = loop.create_future()
            loop.add_reader(connection.fileno(), _set, there)
            try:
                await there
            finally:
                loop.remove_reader(connection.fileno())
            continue
        if not head or b"\r\n\r\n" in head or len(head) == MOST_HEAD:
            return head
        if len(head) == seen:  # it is still there, so it can be read all the time
            await asyncio.sleep(PIECES)
        seen = len(head)


def _set(there: asyncio.Future[None]) -> None:
    if not there.done():
        there.set_result(None)


def serve_processes(parts: Sequence[Part], greeting: str, opened: Callable[[], None] = lambda: None) -> None:
    """Serve a laboratory in several processes until a signal ends it.

    Parameters
    ----------
    parts
        What each process serves.
    greeting
        Printed once all processes take visitors.
    opened
        Called then.
    """
    laboratory = parts[0].laboratory
    listening = bind_sockets(laboratory.port, laboratory.address)
    number = asyncio.run(Front(parts, greeting, opened).run(listening))
    if number != signal.SIGINT:
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)
