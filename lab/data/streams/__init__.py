"""Streams: bytes of a device, or of a recording of one, become timed samples in the axes of the vehicle."""
