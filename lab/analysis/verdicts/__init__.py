"""Verdicts: whether a filter states its errors correctly, and if not, which assumption is wrong, in words."""
