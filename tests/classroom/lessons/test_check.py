"""The language of checks: what it accepts, what it refuses, and how it judges."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pytest

from lab.classroom.lessons import check as language
from lab.classroom.lessons.check import CheckError, parse_check
from lab.classroom.lessons.quantities import QUANTITIES, Quantity

VALUES = {"nis": 1.2, "nees": 3.0, "position_rms": float("nan")}


def fake(consistent: bool = False, *names: str) -> SimpleNamespace:
    """Return a stand-in of a result: checks only ask it for its verdict and its settings."""
    findings = tuple(SimpleNamespace(quantity=name) for name in names)
    settings = {"navigator.r_scale": 0.1, "sensors.gps.lever_arm": (1.0, -3.0, 0.0)}
    return SimpleNamespace(
        verdict=SimpleNamespace(consistent=consistent, findings=findings),
        experiment=SimpleNamespace(get=settings.__getitem__),
    )


@pytest.fixture(autouse=True)
def numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in VALUES.items():
        monkeypatch.setitem(QUANTITIES, name, Quantity("", "", lambda _result, value=value: value))


def accepts(text: str, result: SimpleNamespace | None = None) -> bool:
    parsed = parse_check(text, {"navigator.r_scale", "sensors.gps.lever_arm"}.__contains__)
    return parsed.accepts(result or fake())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text",
    [
        "nis < 2",
        "1 < nis <= 1.2 < nees",
        "nis * 2 + 1 >= 3.4",
        "nees - nis - 1 < 1 and nees - (nis - 1) > 2",
        "nees / nis / 2 < 1.3",
        "-nis < 0 and --nis > 0",
        "(nis + nees) / 2 > 2 and (nis > 1)",
        "not nis > 2 and (nis > 5 or nees > 2)",
        "nis > 5 and nees > 5 or nis < 2",
        "navigator.r_scale < 1e0 and sensors.gps.lever_arm < -2.5",
        "not position_rms < 1 and not position_rms > 1",
        "not nis / (nees - nees) < 1",
        "not verdict consistent",
    ],
)
def test_what_is_true_is_accepted_and_its_contrary_refused(text: str) -> None:
    assert accepts(text)
    assert not accepts(f"not ({text})")


def test_the_verdict_is_named_by_its_whole_quantity() -> None:
    found = fake(False, "GPS latency", "R position")
    assert accepts('verdict names "GPS latency" and verdict names "R position"', found)
    assert not accepts('verdict names "R"', found)
    assert accepts("verdict consistent", fake(True))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "ends where"),
        ("nis", "a comparison"),
        ("nis < ", "a quantity, a setting or a number"),
        ("nis < 1 nees", "character 9: nees"),
        ("nis == 1", "character 5: '='"),
        ("nid < 1", "did you mean nis?"),
        ("navigator.q_scale < 1", "no quantity navigator.q_scale"),
        ("(nis < 1", "ends where ) is expected"),
        ("verdict < 1", 'names "…" or consistent'),
        ("verdict names latency", "in quotes"),
        (
            'nis < 1 and verdict names "GPS latncy"',
            "character 27: there is no finding GPS latncy; did you mean GPS latency?",
        ),
        ('verdict names "typo"', "Accepted are R, R position, R velocity, "),
        ('not verdict names ""', "there is no finding"),
        ("nis < and", "character 7: and"),
        ("__import__('os').system('true') < 1", "is not accepted"),
        ("nis.__class__ < 1", "no quantity nis.__class__"),
        ("nis < 1 ; nees < 1", "';'"),
        ("9" * 40 + " < nis", "a number of more than"),
    ],
)
def test_a_refusal_says_where_and_what_is_accepted(text: str, words: str) -> None:
    with pytest.raises(CheckError) as caught:
        accepts(text)
    assert words in str(caught.value)
    assert re.search("accepted|expected|characters", str(caught.value), re.IGNORECASE)


@pytest.mark.parametrize("deep", ["(", "-", "not "])
def test_length_and_depth_are_bounded(deep: str) -> None:
    with pytest.raises(CheckError, match="inside one another"):
        accepts(deep * (language.DEEPEST + 1) + "nis < 1" + ")" * (language.DEEPEST + 1) * (deep == "("))
    with pytest.raises(CheckError, match="characters"):
        accepts("nis < 1 or " * 40 + "nis < 1")


def test_every_quantity_has_a_meaning_and_a_name_that_the_language_reads() -> None:
    for name, quantity in QUANTITIES.items():
        assert quantity.meaning or name in VALUES
        assert parse_check(f"{name} < 1", lambda _path: False).quantities == (name,)
