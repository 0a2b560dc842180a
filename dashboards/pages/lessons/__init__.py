"""Lessons page: the list of lessons, and the steps of the one that is open."""
