"""Rooms: every import goes down the house, typing-only and local ones too; no room is too large."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parent.parent

FLOORS: tuple[tuple[str, ...], ...] = (
    ("lab.compiled_cache", "lab.earth", "lab.histories", "lab.memory", "lab.notebook_card"),
    ("lab.rotation", "lab.toml_file", "lab.units", "lab.spline_windows", "lab.setting_text", "lab.cache"),
)
