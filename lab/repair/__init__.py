"""Repair: a raw flight, as a file holds it, and the repair of its rows, its time stamps and its noise.

In: columns of a file. Out: a `RawFlight` whose times increase and whose values are plausible one by one.
"""
