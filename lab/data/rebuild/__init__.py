"""Rebuild: a raw flight becomes a recording: rebuilt on a regular grid, judged, and reported.

In: a `RawFlight`. Out: a `Recording`, and a report on what was repaired, rebuilt and assumed.
"""
