"""Bench: a sensor on a desk: six positions, the axes check, rest, and an Allan deviation that grows."""
