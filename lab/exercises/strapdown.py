"""Exercises of notebook 02, strapdown."""

from __future__ import annotations

from lab.exercises.exercise import Exercise

EXERCISES: dict[str, Exercise] = {}
"""Exercises by number."""
