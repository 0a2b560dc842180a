"""Exercises of notebook 03, sensor errors."""

from __future__ import annotations

from lab.exercises.exercise import Exercise

EXERCISES: dict[str, Exercise] = {}
"""Exercises by number."""
