"""Alignment: the start of a navigator at rest or in motion: attitude, heading, biases and P0."""
