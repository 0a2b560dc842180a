"""Checks: whether force, rates, course, velocity, heights and headings of a log contradict each other."""
