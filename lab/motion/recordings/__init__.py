"""Recordings: a recorded flight, its csv file, and how files are read and written safely.

In: a csv file. Out: a `Recording`, or a `MissionError` that says what is wrong and where.
"""
