"""Exercises of notebook 05, tuning."""

from __future__ import annotations

from lab.exercises.exercise import Exercise

EXERCISES: dict[str, Exercise] = {}
"""Exercises by number."""
