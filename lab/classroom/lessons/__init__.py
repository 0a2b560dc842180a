"""Lessons: steps of text, settings and questions as TOML files, and the check of a student's own result."""
