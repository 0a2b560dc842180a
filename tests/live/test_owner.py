"""Who may watch a source, change it, share it and get it, by who opened it."""

from __future__ import annotations

import pytest

from lab.live.owner import Owner, Visitor, may_change, may_join, may_share, may_watch, owned_by

ANN = Visitor("ann", "abc")
BEN = Visitor("ben", "abc")
TEACHER = Visitor("tom", "abc", teaches=True)
OTHER_CLASS = Visitor("eve", "xyz")
OTHER_TEACHER = Visitor("tim", "xyz", teaches=True)
OUTSIDE = Visitor("olga")
ANN_LATER = Visitor("ann")  # the class has ended, or her page has left it
BEN_LATER = Visitor("ben")
TEACHER_LATER = Visitor("tom", "", teaches=True)
EVERYBODY = (
    ANN, BEN, TEACHER, OTHER_CLASS, OTHER_TEACHER, OUTSIDE, ANN_LATER, BEN_LATER, TEACHER_LATER
)  # fmt: skip

OF_ANN = owned_by(ANN)
SHARED = OF_ANN._replace(shared=True)
OF_TEACHER = owned_by(TEACHER)
OF_OUTSIDE = owned_by(OUTSIDE)


def those(may, owner: Owner) -> set[Visitor]:
    return {one for one in EVERYBODY if may(one, owner)}


@pytest.mark.parametrize(
    ("owner", "watch", "change"),
    [
        (OF_ANN, {ANN, ANN_LATER, TEACHER}, {ANN, ANN_LATER, TEACHER}),
        (SHARED, {ANN, ANN_LATER, TEACHER, BEN}, {ANN, ANN_LATER, TEACHER}),
        (OF_TEACHER, set(EVERYBODY), {TEACHER, TEACHER_LATER, OTHER_TEACHER}),
        (OF_OUTSIDE, set(EVERYBODY), set(EVERYBODY)),
    ],
)
def test_who_may_watch_and_change(owner: Owner, watch: set[Visitor], change: set[Visitor]) -> None:
    assert those(may_watch, owner) == watch
    assert those(may_change, owner) == change


def test_the_owner_alone_shares_and_only_in_the_class() -> None:
    assert those(may_share, OF_ANN) == {ANN}
    assert those(may_share, OF_TEACHER) == set()  # all watch it anyway
    assert those(may_share, OF_OUTSIDE) == set()


def test_opening_alike_gives_what_a_teacher_opened_and_never_what_another_student_did() -> None:
    assert those(may_join, OF_ANN) == {ANN, ANN_LATER}
    assert those(may_join, SHARED) == {ANN, ANN_LATER}  # it would end for them when it is shared no longer
    assert those(may_join, OF_TEACHER) == set(EVERYBODY)
    teachers = {TEACHER, OTHER_TEACHER, TEACHER_LATER}
    assert (
        those(may_join, OF_OUTSIDE) == set(EVERYBODY) - teachers
    )  # others could unplug what a teacher shows


def test_what_may_be_changed_or_shared_may_be_watched() -> None:
    for owner in (OF_ANN, SHARED, OF_TEACHER, OF_OUTSIDE):
        for may in (may_change, may_share, may_join):
            assert those(may, owner) <= those(may_watch, owner)
