"""Numbers of things: one of them is in the singular, wherever a live stream is described."""

from __future__ import annotations

import pytest

from lab.base.parameters.counted import count_noun, was_or_were
from lab.data.protocols.recognition import Candidate


@pytest.mark.parametrize(
    ("count", "what", "text"),
    [
        (0, "sample", "0 samples"),
        (1, "sample", "1 sample"),
        (2, "fix", "2 fixes"),
        (1, "fix", "1 fix"),
        (3, "batch", "3 batches"),
    ],
)
def test_one_is_singular(count, what, text):
    assert count_noun(count, what) == text


def test_the_verb_follows():
    assert (was_or_were(0), was_or_were(1), was_or_were(2)) == ("were", "was", "were")


def test_the_evidence_for_a_protocol():
    evidence = Candidate("nmea", 1, 0, 1, 1, 1.0, 1).evidence
    assert evidence == "Recognised as NMEA from 1 valid frame."
    evidence = Candidate("vectornav", 3, 1, 2, 2, 0.5, 200).evidence
    assert evidence == "Recognised as VectorNav from 3 valid frames; 50% of the bytes belong to none."
