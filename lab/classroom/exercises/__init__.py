"""Exercises of the notebooks: questions whose answers are checked, with a hint for each usual mistake."""
