"""Ending: a server that is asked to end does end, also when it is asked twice."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

BESIDE = """
import signal, sys
signal.signal(signal.SIGTERM, lambda *_: print("asked", flush=True))
print("there", flush=True)
sys.stdin.read()
"""
SERVER = f"""
import asyncio, subprocess, sys
from dashboards.ending import end_on_signals

beside = subprocess.Popen([sys.executable, "-c", {BESIDE!r}])

def end():
    beside.terminate()
    beside.wait()

async def stand():
    end_on_signals(asyncio.get_running_loop(), list, lambda: None, iter([end]))
    print("there", flush=True)
    await asyncio.Event().wait()

asyncio.run(stand())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes without signals")
def test_a_second_signal_while_the_first_is_handled_ends_the_server() -> None:
    # make passes on each SIGTERM that its children got already.
    with subprocess.Popen(
        [sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as server:
        assert server.stdout is not None
        assert {server.stdout.readline() for _ in range(2)} == {b"there\n"}
        server.terminate()
        assert server.stdout.readline() == b"asked\n"  # the server waits for the process beside it
        server.terminate()
        try:
            assert server.wait(60) == -signal.SIGTERM
        finally:
            server.kill()
