"""Documented lines: those of docs/streams-out.md are what is sent, byte for byte."""

from __future__ import annotations

import json
from pathlib import Path

from sent_solutions import solution

from lab.data.protocols.foxglove import CHANNELS
from lab.data.protocols.nmea_encoder import encode_sentences
from lab.data.protocols.sent_solution import json_line

DOCUMENT = (Path(__file__).parents[3] / "docs" / "streams-out.md").read_text("utf-8")


def block(language: str) -> str:
    return DOCUMENT.split(f"```{language}\n")[1].split("```")[0]


def test_the_object_is_the_one_that_is_sent() -> None:
    shown, sent = json.loads(block("json")), json.loads(json_line(solution()))
    assert list(shown) == list(sent)
    assert shown == sent


def test_the_sentences_are_those_that_are_sent() -> None:
    assert block("text") == encode_sentences(solution()).decode().replace("\r\n", "\n")


def test_the_channels_are_those_that_are_offered() -> None:
    for one in CHANNELS:
        assert f"| `{one.topic}` | `{one.schema_name}` |" in DOCUMENT
