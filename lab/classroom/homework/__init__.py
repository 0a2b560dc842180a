"""Homework: scenarios with hidden settings, the small files that students hand in, and their grades."""
