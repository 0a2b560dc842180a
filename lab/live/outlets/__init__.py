"""Outlets: the live solution goes out to other programs, as they read it.

In: the states of a live navigator, and destinations that whoever starts the command has named. Out: lines of
JSON, NMEA and MAVLink by UDP, TCP, WebSocket and pseudo-terminal, Foxglove's WebSocket, and MCAP files. The
navigator's thread hands a state over and goes on: a reader that is too slow loses rows, which are counted.

Read first: `destination` (what may be named), `publisher` (the thread that sends), `reader` (one
reader, and what it loses).
"""
