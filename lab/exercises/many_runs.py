"""Exercises of notebook 10, many runs."""

from __future__ import annotations

from lab.exercises.exercise import Exercise

EXERCISES: dict[str, Exercise] = {}
"""Exercises by number."""
