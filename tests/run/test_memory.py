"""Memory: rows that were used and freed blocks are given back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lab.run import memory


def taken() -> int:
    """Return the memory of this process [bytes]."""
    return 1024 * int(Path("/proc/self/status").read_text().split("VmRSS:")[1].split()[0])


def printed_by(program: str) -> list[float]:
    """Return the numbers that a process of its own prints."""
    ran = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    return [float(number) for number in ran.stdout.split()]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux takes back a part of an array")
def test_rows_that_were_used_take_half_of_their_memory() -> None:
    exact = np.linspace(0.0, 1.0, 6_000_000).reshape(-1, 3)
    wanted, before = exact.astype(np.float32), taken()
    retiring = memory.Retiring(exact)
    for first in range(1_999_000, -1, -1000):
        retiring.retire(first)
    assert before - taken() > 0.4 * exact.nbytes
    np.testing.assert_array_equal(retiring.kept, wanted)
    assert retiring.left == 0


@pytest.mark.skipif(sys.platform != "linux", reason="only the C library of GNU keeps freed memory")
def test_freed_memory_is_given_back() -> None:
    blocks = [np.ones(8000) for _ in range(2000)]  # 128 MB, in blocks that are not mapped alone
    last = blocks.pop()  # keeps the end of the heap
    blocks.clear()
    before = taken()
    memory.give_back()
    assert last.size
    assert before - taken() > 100e6


GARBAGE = """
import gc
import numpy as np
from lab.run import memory

rows = np.ones(100_000)
memory.give_back()
memory.release_pages(np.ones(100_000))
gc.collect()
gc.disable()
for _ in range(3):
    memory.give_back()
    memory.release_pages(rows)
print(gc.collect())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux takes back a part of an array")
def test_giving_back_leaves_no_garbage() -> None:
    """A server gives back with each page that ends. In a process of its own: other threads leave garbage."""
    assert printed_by(GARBAGE) == [0]


FREEING = """
import numpy as np
from lab.run import memory
from tests.run.test_memory import taken

def given_back():
    blocks = [np.ones(1_000_000) for _ in range(17)]  # 136 MB
    last = blocks.pop()  # keeps the end of the heap
    before = taken()
    blocks.clear()
    assert last.size
    return before - taken()

with memory.large_blocks_given_back(memory.VERY_LONG + 1):
    print(given_back())
with memory.large_blocks_given_back(memory.VERY_LONG):
    print(given_back())
outer, inner = (memory.large_blocks_given_back(memory.VERY_LONG + 1) for _ in range(2))
outer.__enter__()
inner.__enter__()
outer.__exit__(None, None, None)
print(given_back())
inner.__exit__(None, None, None)
print(given_back())
"""
SERVING = """
import threading
import numpy as np
from lab.run import memory
from tests.run.test_memory import taken

def in_a_thread(work):
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()

def left():
    before, kept = taken(), []
    def stream():
        blocks = [np.ones(100_000) for _ in range(200)]  # 160 MB
        kept.append(np.ones(10))
        blocks.clear()
    for _ in range(3):
        in_a_thread(stream)
    return taken() - before

memory.keep_few_freed_blocks()
with memory.large_blocks_given_back(memory.VERY_LONG + 1):
    print(left())
print(left())
"""


@pytest.mark.proof
@pytest.mark.skipif(sys.platform != "linux", reason="only the C library of GNU keeps freed memory")
def test_a_server_gives_the_blocks_of_ended_streams_back() -> None:
    beside_a_long_flight, after = printed_by(SERVING)
    assert beside_a_long_flight < 20e6
    assert after < 20e6


@pytest.mark.skipif(sys.platform != "linux", reason="only the C library of GNU keeps freed memory")
def test_a_very_long_flight_gives_large_blocks_back_at_once_and_others_keep_them() -> None:
    """In a process of its own: another may have free memory, which is used first."""
    very_long, others, one_of_two, after = printed_by(FREEING)
    assert very_long > 100e6
    assert others < 30e6
    assert one_of_two > 100e6, "another is still worked on"
    assert after < 30e6
