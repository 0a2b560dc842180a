"""Frames: the one Earth, rotations, axes of the Earth, metres to latitude and back."""
