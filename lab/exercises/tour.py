"""Exercises of notebook 01, the tour."""

from __future__ import annotations

from lab.exercises.exercise import Exercise

EXERCISES: dict[str, Exercise] = {}
"""Exercises by number."""
