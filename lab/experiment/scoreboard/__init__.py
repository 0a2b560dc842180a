"""Scoreboard: public data sets, each navigated by the lab and by other programs under a published protocol.

In: a folder that holds files of a data set. Out: a row for each program, with figures and what they rest on.
Nothing is fetched. `results.json` holds the rows that stood; a newer one replaces a row, and none is removed.

Read first: `registry` (which sets there are), `comparison` (what is run), `results` (what is kept).
"""
