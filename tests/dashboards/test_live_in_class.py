"""The page Live in a class: whose sources a page shows, and what it may do with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dashboards import phones, visitors
from dashboards.devices import STATIONS
from dashboards.pages.live.axes_part import OTHERS_AXES
from dashboards.pages.live.live import ALLAN, ERRORS, NOT_ANY_MORE, TWIN
from dashboards.pages.live.source_fields import PHONE, WATCHED
from lab.data.streams.axis_map import AxisMap
from lab.live.bench.axis_check import CheckedAxes
from lab.live.owner import Visitor
from lab.live.phone.phone import INVITED
from lab.live.stations import ENDED
from lab.missions.catalogue import OWN_FOLDER_VARIABLE
from tests.dashboards.test_live_page import Opened, columns, wait_until_nothing_is_left


class Room:
    """Pages of a class, whose visitors a test changes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch
        self._visitors: dict[str, Visitor] = {}
        self.pages: list[Opened] = []

    def page(self, name: str, school_class: str = "abc", *, teaches: bool = False) -> Opened:
        """Open a page of somebody; two pages of one name are tabs of one browser."""
        self._visitors[name] = Visitor(name, school_class, teaches, "" if teaches else name)
        made = Opened(self._monkeypatch)
        made.session.visitor = lambda: self._visitors[name]
        made.page.appear()
        self.pages.append(made)
        return made

    def leave(self, *names: str) -> None:
        """Let people leave the class; with all of them, it ends."""
        for name in names:
            self._visitors[name] = self._visitors[name]._replace(school_class="")


@pytest.fixture
def room(monkeypatch: pytest.MonkeyPatch) -> Iterator[Room]:
    made = Room(monkeypatch)
    yield made
    for one in made.pages:
        one.close()
    wait_until_nothing_is_left()


def watchable(one: Opened) -> list[str]:
    """Return the keys of what a page offers to watch."""
    offers = one.page._fields._offers().values()
    return [value.removeprefix(WATCHED) for value in offers if value.startswith(WATCHED)]


def ask(one: Opened, key: str) -> str:
    """Ask to watch a source as a hand-made message can, and return what is said."""
    wanted = f"{WATCHED}{key}"
    fields = one.page._fields
    fields._source.param.update(options={**fields._source.options, wanted: wanted}, value=wanted)
    one.page._toggle()
    one.until(lambda: not one.page._job.busy and (one.page._watched is not None or bool(said(one))))
    return said(one)


def said(one: Opened) -> str:
    return one.page._job._after.text


def key_of(one: Opened) -> str:
    assert one.page._watched is not None
    return one.page._watched.key


@pytest.mark.proof
def test_a_source_of_a_student_is_seen_by_its_owner_and_the_teacher(room: Room) -> None:
    ann, ben, teacher = room.page("ann"), room.page("ben"), room.page("tom", teaches=True)
    guest, other = room.page("guest", ""), room.page("eve", "xyz")
    station = ann.connect()
    key = key_of(ann)
    for one in (ben, guest, other):
        assert watchable(one) == []
        assert ask(one, key) == ENDED
        assert one.page._station is None
    assert STATIONS.watchers(key) == 1
    for one in (room.page("ann"), teacher):
        assert watchable(one) == [key]
        assert ask(one, key) == ""
        assert one.page._station is station
        assert one.page._unplug.visible
    assert ann.page._share.visible
    assert not teacher.page._share.visible


@pytest.mark.proof
def test_a_student_who_opens_the_same_gets_another_device(room: Room) -> None:
    ann, ben, teacher = room.page("ann"), room.page("ben"), room.page("tom", teaches=True)
    first, second, third = ann.connect(), ben.connect(), teacher.connect()
    assert len({id(first), id(second), id(third)}) == 3
    assert room.page("cleo").connect() is third  # what the teacher opened, the class sees


def test_all_watch_what_the_teacher_opens_and_none_turns_or_unplugs_it(room: Room) -> None:
    teacher, ben, guest = room.page("tom", teaches=True), room.page("ben"), room.page("guest", "")
    station = teacher.connect()
    device = station.source.device
    assert device is not None
    for one in (ben, guest):
        assert ask(one, key_of(teacher)) == ""
        assert one.page._station is station
        assert not one.page._unplug.visible
        assert not one.page._share.visible
        assert one.page._axes._rights.visible
        one.page._pull_plug()  # hand-made: there is no button
        assert device.plugged
        one.page._axes._found = CheckedAxes(AxisMap.of("y,-x,z"), "", None)
        one.page._axes.tell_rights()
        assert one.page._axes._use.disabled
        one.page._axes._apply()
        assert one.page._axes._notice.text == OTHERS_AXES
        assert station.source.axes == AxisMap()
    assert teacher.page._unplug.visible
    assert not teacher.page._axes._rights.visible


def test_what_is_shared_no_longer_is_gone_at_once_for_others(room: Room) -> None:
    ann, ben, cleo = room.page("ann"), room.page("ben"), room.page("cleo")
    station = ann.connect()
    key = key_of(ann)
    ben.page._share_or_not(True)  # without a source
    ann.page._share.value = True
    assert watchable(ben) == [key]
    for one in (ben, cleo):
        assert ask(one, key) == ""
        one.until(lambda one=one: columns(one.page) > 10)
        assert not one.page._share.visible
        one.page._share_or_not(False)  # hand-made
        assert one.page._station is station
    cleo.page.hide()
    for part in (ERRORS, ALLAN, TWIN):
        ben.page._choice.value = part
    ann.page._share.value = False
    for one in (ben, cleo):
        page = one.page
        parts = (page, page._errors, page._axes, page._allan, page._twin, page._recorder)
        assert [part._station for part in parts] == [None] * len(parts)
        page._look()
        assert page._watched is None
        assert NOT_ANY_MORE in page._status.hint.object
        assert page._connect.label == "Connect"
        assert columns(page) == 0
    assert watchable(ben) == []
    ann.until(lambda: STATIONS.watchers(key) == 1)
    assert not station.source.ended
    assert ann.page._station is station


@pytest.mark.proof
def test_offers_follow_without_another_click(room: Room) -> None:
    ann, ben = room.page("ann"), room.page("ben")
    ann.connect()
    before = ben.page._fields._source.options
    ben.page._look()
    assert ben.page._fields._source.options == before
    ann.page._share.value = True
    ben.page._look()
    assert f"{WATCHED}{key_of(ann)}" in ben.page._fields._source.options.values()
    ann.page._share.value = False
    ben.page._look()
    assert ben.page._fields._source.options == before


@pytest.mark.proof
def test_when_the_class_ends_the_owner_alone_goes_on(room: Room) -> None:
    ann, ben, teacher = room.page("ann"), room.page("ben"), room.page("tom", teaches=True)
    of_ann, of_teacher = ann.connect(), teacher.connect()
    ann.page._share.value = True
    tab = room.page("ben")
    assert ask(ben, key_of(ann)) == ask(tab, key_of(teacher)) == ""
    again = room.page("tom", teaches=True)
    assert ask(again, key_of(ann)) == ""
    room.leave("ann", "ben", "tom")
    for one in (ann, ben, tab, teacher, again):
        one.page._look()
    assert ben.page._watched is again.page._watched is None
    assert ann.page._station is of_ann
    assert ann.page._unplug.visible
    assert not ann.page._share.visible
    assert tab.page._station is of_teacher
    assert not tab.page._unplug.visible
    assert watchable(ben) == [key_of(teacher)]
    assert ask(ben, key_of(ann)) == ENDED
    late = room.page("dan", "def")
    assert ask(late, key_of(ann)) == ENDED


def test_outside_of_a_class_all_do_what_they_like(room: Room) -> None:
    guest, other, ben = room.page("guest", ""), room.page("other", ""), room.page("ben")
    station = guest.connect()
    assert other.connect() is station
    assert ask(ben, key_of(guest)) == ""
    for one in (guest, other, ben):
        assert one.page._unplug.visible
        assert not one.page._axes._rights.visible
        assert not one.page._share.visible


@pytest.mark.proof
def test_a_third_source_is_refused_and_the_refusal_says_which_are_open(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(phones.VARIABLE, "127.0.0.1:0")
    first, second, third = (room.page("ann") for _ in range(3))
    for number, one in enumerate((first, second, third), 1):
        one.session.experiment.seed = number
    names = [first.connect().name, second.connect().name]
    third.page._toggle()
    third.until(lambda: "Disconnect one" in said(third))
    for name in names:
        assert f"“{name}”" in said(third)
    try:
        third.page._fields._source.value = PHONE
        third.page._toggle()  # is refused before somebody takes out a phone
        assert "2 sources open" in said(third)
        assert not third.page._inviting.waiting
    finally:
        phones.close_phone_server()
    first.page._toggle()
    third.until(lambda: len(STATIONS.keys()) == 1)
    third.page._fields._source.value = "simulated"
    third.connect()


def test_the_number_of_a_phone_gives_nothing_to_others(
    room: Room, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setenv(phones.VARIABLE, "127.0.0.1:0")
    ann, ben, teacher = room.page("ann"), room.page("ben"), room.page("tom", teaches=True)
    try:
        ann.page._fields._source.value = PHONE
        ann.page._toggle()
        hub = phones.phone_server().hub
        (key,) = hub._phones
        for asked in (f"phone {key}", "phone 99", "phone x", "phone "):
            assert ask(ben, asked) == ENDED  # whether it is invited or not
        assert [state.state for state in hub.phones()] == [INVITED]
        assert hub.claim(hub._phones[key], "device", "Ann")
        ann.until(lambda: ann.page._inviting._look() is None and ann.page._station is not None)
        for asked in (f"phone {key}", "phone 99"):
            assert ask(ben, asked) == ENDED
        assert "Ann" not in str(ben.page._fields._offers())
        assert len(hub.phones()) == 1
        assert "Watch: Ann" in teacher.page._fields._offers()
        assert ask(teacher, f"phone {key}") == ""
        teacher.page._toggle()
        ann.until(lambda: STATIONS.watchers(f"phone {key}") == 1)
        assert len(hub.phones()) == 1
        ann.page._toggle()
        ann.until(lambda: hub.phones() == [])
    finally:
        phones.close_phone_server()


def test_a_recording_of_what_is_shared_no_longer_ends(
    room: Room, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(visitors, "_decided", {visitors.VARIABLE: "edit"})
    ann, ben = room.page("ann"), room.page("ben")
    station = ann.connect()
    ann.page._share.value = True
    assert ask(ben, key_of(ann)) == ""
    ben.page._recorder._begin()
    assert station.source.recording is not None
    ann.page._share.value = False
    ben.page._look()
    assert station.source.recording is None
    ben.page._recorder._begin()
    assert station.source.recording is None
    ben.until(lambda: not ben.page._recorder._job.busy)


def test_a_card_that_is_ready_too_late_is_not_given(room: Room) -> None:
    ann, ben = room.page("ann"), room.page("ben")
    station = ann.connect()
    ann.page._share.value = True
    assert ask(ben, key_of(ann)) == ""
    ann.page._share.value = False
    card: Callable[..., object] = pytest.fail
    ben.page._allan._maker._made(station, card)  # type: ignore[arg-type]
    assert ben.page._allan.card is None
    assert not ben.page._allan._maker.download.visible
