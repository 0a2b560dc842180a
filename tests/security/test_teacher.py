"""The link for teachers of a served laboratory, and a small class that follows over websockets."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from hashlib import sha256
from html import escape
from http.client import HTTPConnection
from typing import Any

import numpy as np
import pytest

from dashboards.teaching import teacher
from tests.benchmarks.followers import class_of, steps
from tests.security.conftest import Served, serving

STUDENTS = 3
"""Pages that follow: the benchmark has thirty."""


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Return a laboratory with a link for teachers."""
    with serving(tmp_path_factory.mktemp("taught"), "--address", "0.0.0.0", "--teacher") as found:
        yield found


def ask(served: Served, path: str) -> tuple[int, dict[str, str], str]:
    """Return status, headers and text of an answer, which is not followed."""
    way = HTTPConnection("127.0.0.1", served.port, timeout=60)
    way.request("GET", path)
    answer = way.getresponse()
    return answer.status, dict(answer.getheaders()), answer.read().decode()


@pytest.mark.proof
def test_the_link_becomes_a_cookie_and_leaves_the_address(taught: Served) -> None:
    found = re.search(r"Teachers open http://[^/]+(/teach\?key=([\w-]{43,})) and", taught.log.read_text())
    assert found is not None
    status, headers, _ = ask(taught, found[1])
    assert (status, headers["Location"]) == (302, "./")
    cookie = headers["Set-Cookie"]
    assert cookie.startswith(f"{teacher.COOKIE}_{taught.port}={found[2]};")
    assert "HttpOnly" in cookie
    assert "SameSite=Lax" in cookie
    assert "expires" not in cookie.lower()  # ends with the browser


@pytest.mark.parametrize("key", ["", "?key=", "?key=wrong", "?key=" + "x" * 43, "?key=%00<script>x"])
def test_another_link_makes_no_teacher(taught: Served, key: str) -> None:
    status, headers, text = ask(taught, f"/teach{key}")
    assert status == 403
    assert "Set-Cookie" not in headers
    assert "not a valid link for a teacher" in text
    assert "<script>x" not in text


def test_a_token_is_new_each_time_and_valid_for_one_server_only() -> None:
    assert not teacher.is_token("")
    first, second = teacher.new_token(), teacher.new_token()
    teacher.admit_holders(5006, [sha256(first.encode()).digest()])
    teacher.admit_holders(5007, [sha256(second.encode()).digest()])
    try:
        assert len(first) >= 43  # 256 bits
        assert teacher.is_token(second)
        for wrong in (first, second[:-1], second + " ", second.swapcase(), "\ud800", "ø"):
            assert not teacher.is_token(wrong)
        assert teacher.is_teacher({f"{teacher.COOKIE}_5006": first, f"{teacher.COOKIE}_5007": second})
        assert not teacher.is_teacher({f"{teacher.COOKIE}_5006": second, teacher.COOKIE: second})
    finally:
        teacher.admit_holders(5007, [])
    assert not teacher.is_token(second)


@pytest.mark.proof
def test_a_small_class_follows_its_teacher(taught: Served, run: Callable[..., Any]) -> None:
    async def follow() -> tuple[list[float], bool]:
        async with class_of(taught, STUDENTS) as (leads, followers):
            delays = [delay async for step in steps(leads, followers, 0.0) for delay in step.delays]
            leads.forget()
            followers[0].close()
            here = escape(f"<b>{STUDENTS - 1}</b> here")
            gone = await leads.until(lambda page: page.has(here))
            return delays, bool(np.isfinite(gone))

    delays, is_counted_out = run(follow())
    assert len(delays) == 6 * STUDENTS
    assert np.isfinite(delays).all()
    assert is_counted_out
    assert "Traceback" not in taught.log.read_text()
