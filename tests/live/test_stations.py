"""Stations of a server: who gets which, what a visitor learns of others, and how many one may open."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import cast

import pytest

from lab.data.streams.transport import TransportError
from lab.live.owner import Owner, Visitor
from lab.live.station import Station
from lab.live.stations import ENDED, MOST, MOST_OF_ONE, Stations

PATIENCE = 60.0
ANN = Visitor("ann", "abc", counted="ann")
BEN = Visitor("ben", "abc", counted="ben")
TEACHER = Visitor("tom", "abc", teaches=True)
SERVES = Visitor("me")
OLGA, PAUL = Visitor("olga", counted="olga"), Visitor("paul", counted="paul")


class Made:
    """A station without a source."""

    def __init__(self, name: str = "a phone") -> None:
        self.name, self.owner, self.closed = name, Owner(), False

    def close(self) -> None:
        """End."""
        self.closed = True


def made(name: str = "a phone") -> Callable[[], Station]:
    return lambda: cast(Station, Made(name))


def never() -> Station:
    raise AssertionError("must not be made")


def test_a_forbidden_key_is_answered_as_one_that_does_not_exist() -> None:
    stations = Stations()
    key, station = stations.open("phone 7", "page", made("Ann"), ANN)
    for visitor in (BEN, OLGA, ANN._replace(identity="other")):
        assert stations.names(visitor) == {}
        answers = []
        for asked in (key, "phone 8", ""):
            with pytest.raises(TransportError) as refused:
                stations.watch(asked, "other page", visitor)
            answers.append(str(refused.value))
        assert answers == [ENDED] * 3
        assert stations.watchers(key) == 1
    for number, visitor in enumerate((ANN, TEACHER)):
        assert stations.names(visitor) == {key: "Ann"}
        assert stations.watch(key, f"page {number}", visitor) is station


def test_sharing_is_the_owners_and_can_be_taken_back() -> None:
    stations = Stations()
    key, _ = stations.open("sim", "page", made(), ANN)
    for visitor in (BEN, TEACHER, OLGA, ANN._replace(school_class="")):
        stations.share(key, visitor, True)
        assert stations.names(BEN) == {}
    stations.share(key, ANN, True)
    assert stations.names(BEN) == {key: "a phone"}
    assert stations.names(OLGA) == {}
    stations.share(key, ANN, False)
    assert stations.names(BEN) == {}
    stations.share("no such key", ANN, True)


def test_students_who_open_alike_have_a_source_each_and_their_teacher_another() -> None:
    stations = Stations()
    of_ann, first = stations.open("sim", 1, made(), ANN)
    of_ben, second = stations.open("sim", 2, made(), BEN)
    of_teacher, third = stations.open("sim", 3, made(), TEACHER)
    assert len({of_ann, of_ben, of_teacher}) == 3
    assert len({id(first), id(second), id(third)}) == 3
    assert stations.open("sim", 4, never, ANN) == (of_ann, first)
    cleo = Visitor("cleo", "abc", counted="cleo")
    assert stations.open("sim", 5, never, cleo) == (of_teacher, third)
    assert list(stations.names(TEACHER).values()) == ["a phone", "a phone (2)", "a phone (3)"]
    # Numbers say nothing about what one does not see.
    assert stations.names(BEN) == {of_ben: "a phone", of_teacher: "a phone (2)"}


def test_outside_of_a_class_pages_share_what_they_open_alike() -> None:
    stations = Stations()
    key, station = stations.open("sim", 1, made(), OLGA)
    assert stations.open("sim", 2, never, PAUL) == (key, station)
    assert stations.names(ANN) == {key: "a phone"}
    assert not stations.leave(key, 1)
    assert stations.leave(key, 2)
    assert not stations.leave(key, 2)
    assert cast(Made, station).closed


def test_a_port_that_only_one_can_read_says_that_it_is_in_use_and_no_more() -> None:
    stations = Stations()
    key, _ = stations.open("udp:5555", 1, made("Ann's board"), ANN, alone=True)
    with pytest.raises(TransportError, match=r"udp:5555 is in use") as refused:
        stations.open("udp:5555", 2, never, BEN, alone=True)
    assert "Ann" not in str(refused.value)
    assert stations.open("udp:5555", 3, never, TEACHER, alone=True)[0] == key
    stations.share(key, ANN, True)
    assert stations.open("udp:5555", 4, never, BEN, alone=True)[0] == key


def test_a_visitor_opens_two_and_a_place_comes_back() -> None:
    stations = Stations()
    first, _ = stations.open("one", 1, made("the board"), ANN)
    stations.open("two", 2, made("the phone"), ANN)
    with pytest.raises(TransportError, match=r"2 sources open: “the board” and “the phone”.*Disconnect"):
        stations.open("three", 3, never, ANN)
    with pytest.raises(TransportError, match="Accepted are up to 2"):
        stations.check_place(ANN)
    stations.check_place(BEN)
    assert stations.open("one", 3, never, ANN)[0] == first  # to watch what is open takes no place
    stations.watch(first, 4, TEACHER)
    stations.leave(first, 1)
    with pytest.raises(TransportError):
        stations.check_place(ANN)  # another page of hers still watches it
    stations.leave(first, 3)
    stations.open("three", 5, made(), ANN)  # the teacher alone watches the first
    assert len(stations.keys()) == 3


def test_what_a_visitor_may_not_watch_is_not_named_in_the_refusal() -> None:
    stations = Stations()
    here = "computer 192.0.2.7"  # browsers without cookies share the places of their computer
    ann, ben = ANN._replace(counted=here), BEN._replace(counted=here)
    stations.open("one", 1, made("Ann"), ann)
    stations.open("two", 2, made("Ben"), ben)
    with pytest.raises(TransportError) as refused:
        stations.open("three", 3, never, ben)
    assert "“Ben”" in str(refused.value)
    assert "Ann" not in str(refused.value)


def test_whoever_serves_opens_all_and_the_bound_of_the_server_holds_for_all() -> None:
    for visitor in (SERVES, TEACHER):
        stations = Stations()
        for number in range(MOST):
            stations.open(str(number), number, made(), visitor)
        with pytest.raises(TransportError, match=f"accepted are up to {MOST}"):
            stations.open("one more", 99, never, visitor)


def test_tabs_that_open_at_once_get_no_third_source() -> None:
    """None has been made before all have asked."""
    tabs = 6
    stations = Stations()
    asked = threading.Semaphore(0)
    go_on = threading.Event()

    def slow() -> Station:
        asked.release()
        assert go_on.wait(PATIENCE)
        return made()()

    def open_one(number: int) -> bool:
        try:
            stations.open(f"source {number}", number, slow, ANN)
        except TransportError:
            asked.release()
            return False
        return True

    with ThreadPoolExecutor(tabs) as pool:
        opened = [pool.submit(open_one, number) for number in range(tabs)]
        for _ in range(tabs):
            assert asked.acquire(timeout=PATIENCE)
        go_on.set()
    assert sum(one.result() for one in opened) == MOST_OF_ONE
    assert len(stations.keys()) == MOST_OF_ONE


def test_two_who_open_alike_at_once_get_one_source_and_take_one_place() -> None:
    stations = Stations()
    begun, go_on = threading.Event(), threading.Event()

    def slow() -> Station:
        begun.set()
        assert go_on.wait(PATIENCE)
        return made()()

    stations.open("another", 0, made(), ANN)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(stations.open, "sim", 1, slow, ANN)
        assert begun.wait(PATIENCE)
        second = pool.submit(stations.open, "sim", 2, never, ANN)
        go_on.set()
        assert first.result(PATIENCE) == second.result(PATIENCE)


def test_a_source_that_cannot_be_opened_takes_no_place() -> None:
    stations = Stations(most=1, most_of_one=1)

    def fail() -> Station:
        raise ValueError("no such port")

    for _ in range(3):
        with pytest.raises(ValueError, match="no such port"):
            stations.open("one", 1, fail, ANN)
    stations.open("one", 1, made(), ANN)
    stations.close()
    assert stations.keys() == set()
