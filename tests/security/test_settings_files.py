"""A settings file, a card or a mission from a stranger costs little, and ends in a sentence."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from processor_time import takes_less_than
from typer.testing import CliRunner

from lab import Experiment, MissionError, SettingError
from lab.base.parameters.toml_file import MAX_BYTES, MAX_PARTS, TomlError, parse_toml, toml_text
from lab.cli import app
from lab.data.files.sensor_log_csv import log_files
from lab.flying.motion_file import read_motion_file
from lab.missions import mission
from lab.sensors.cards import read_cards

ROOT = Path(__file__).parents[2]
SECONDS = 1.0
"""Time of a processor that an attack may take [s]: more would be felt by everybody else."""
MEMORY = 200e6
"""Memory an attack may take [bytes]."""

DOTS = "a" + ".a" * 100_000 + " = 1"
ATTACKS = {
    "a key of many parts": (DOTS, "a key of more than 8 parts"),
    "a table of many parts": (f"[a{'.a' * 20_000}]", "a key of more than 8 parts"),
    "parts in quotes": ('"a"' + " . 'b'" * 20_000 + " = 1", "a key of more than 8 parts"),
    "a key after a text with quotes at its end": (
        f'x = ["""a"""", {{ {DOTS} }}]',
        "a key of more than 8 parts",
    ),
    "a key after an apostrophe": (f"x = ['''a''''', {{ {DOTS} }}]", "a key of more than 8 parts"),
    "an integer of many digits": (f"seed = {'1' * 5000}", "a number or a key of more than 1000 characters"),
    "an integer of many hexadecimal digits": (f"seed = 0x{'f' * 5000}", "a number or a key of more than"),
    "a key of many letters": (f"{'a' * 5000} = 1", "a number or a key of more than"),
    "deep lists": ("seed = " + "[" * 5000, "brackets inside one another more than 16 times"),
    "deep tables": ("seed = " + "{a = " * 5000, "brackets inside one another more than 16 times"),
    "many values": ("seed = [" + "1," * 150_001 + "]", "more than 150000 values"),
    "a large text": ("#" * (MAX_BYTES + 1), "accepted are TOML files up to 1 MB"),
}

Reader = Callable[[Path], object]
READERS: dict[str, tuple[Reader, type[Exception]]] = {
    "settings": (Experiment.from_toml, SettingError),
    "cards": (read_cards, SettingError),
    "missions": (mission, MissionError),
    "logs": (log_files, MissionError),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("attack", ATTACKS)
def test_what_is_too_much_is_refused_before_it_is_parsed(reader: str, attack: str, tmp_path: Path) -> None:
    (text, words), (read, kind) = ATTACKS[attack], READERS[reader]
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with takes_less_than(SECONDS), pytest.raises(kind, match=words) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.proof
def test_the_worst_that_is_accepted_takes_little_memory() -> None:
    text = "".join(f"[t{number}.b.c.d.e.f.g.h]\n" for number in range(16_000))
    tracemalloc.start()
    try:
        assert len(parse_toml(text)) == 16_000
        assert tracemalloc.get_traced_memory()[1] < MEMORY
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.timeout(20)
def test_only_ordinary_files_are_read(reader: str, tmp_path: Path, make_pipe: Callable[[Path], None]) -> None:
    pipe = tmp_path / "mine.toml"
    make_pipe(pipe)
    device = tmp_path / "zero.toml"
    device.symlink_to("/dev/zero")
    read, kind = READERS[reader]
    for path in (pipe, device):
        with pytest.raises(kind, match="ordinary file"):
            read(path)


def test_a_motion_definition_is_an_ordinary_file(tmp_path: Path, make_pipe: Callable[[Path], None]) -> None:
    make_pipe(tmp_path / "motion.csv")
    with pytest.raises(MissionError, match="ordinary file"):
        read_motion_file(tmp_path / "motion.csv")


@pytest.mark.parametrize("option", ["--config", "--card", "--set"])
@pytest.mark.parametrize(
    "attack", ["an integer of many digits", "deep lists", "an integer of many hexadecimal digits"]
)
def test_the_command_line_answers_with_a_sentence(option: str, attack: str, tmp_path: Path) -> None:
    text, _ = ATTACKS[attack]
    path = tmp_path / "mine.toml"
    path.write_text(text)
    answer = CliRunner().invoke(app, ["run", "montreal", option, text if option == "--set" else str(path)])
    assert answer.exit_code == 2
    assert "Traceback" not in answer.output
    assert len(answer.output) < 1000


def test_a_seed_of_many_digits_is_a_sentence() -> None:
    answer = CliRunner().invoke(app, ["run", "montreal", "--seed", "1" * 5000])
    assert answer.exit_code == 2
    assert isinstance(answer.exception, SystemExit)


@pytest.mark.proof
def test_what_the_lab_writes_is_accepted() -> None:
    command = {
        "type": 1, "yaw_deg": 12.345678, "pitch_deg": 0.0, "roll_deg": -12.5, "forward_m_s": 123.456,
        "right_m_s": 0.0, "down_m_s": 0.25, "duration_s": 12.5, "gps": 1,
    }  # fmt: skip
    plan = {"flight": {"commands": [command] * 6000}}
    assert parse_toml(toml_text(plan)) == plan
    deep: object = 1.5e300
    for _ in range(8):
        deep = {"a b": [deep, "0" * 5000]}
    assert parse_toml(toml_text({"x": deep})) == {"x": deep}
    key = ".".join(["a"] * MAX_PARTS)
    assert parse_toml(f"{key} = 1\n'1.2.3.4.5.6.7.8.9.10' = '[[[[[[[[[[[[[[[[[['")


PIECES = st.sampled_from(
    [
        '"',
        '""',
        '"""',
        "'",
        "''",
        "'''",
        "\\",
        "\n",
        "#",
        "[",
        "]",
        "{",
        "}",
        "=",
        ",",
        ".",
        "a",
        "1",
        " ",
        DOTS,
    ]
)


@given(st.lists(PIECES, max_size=12).map("".join))
@example(f'"""{DOTS}"""')
@example(f'a = """\\""""\n{DOTS}')
@example(f"a = ''\n{DOTS}")
@example(f'a = "\\\n{DOTS}')
def test_no_text_hides_a_key_of_many_parts(text: str) -> None:
    """Whatever stands before it, a key that would take `tomllib` long is seen, or is part of a text."""
    with takes_less_than(SECONDS):
        try:
            parse_toml(text)
        except TomlError as error:
            assert "RecursionError" not in str(error)


def test_one_reader_is_used_everywhere() -> None:
    named = [
        str(path.relative_to(ROOT))
        for folder in ("lab", "dashboards")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if "import tomllib" in path.read_text(encoding="utf-8")
    ]
    assert named == ["lab/base/parameters/toml_file.py"]
