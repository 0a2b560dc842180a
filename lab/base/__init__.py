"""Base: what every room uses and no flight is in: settings, units, files, compiling, the cache.

In: text, files and functions. Out: settings with units and bounds, files that appear whole or not at all,
compiled kernels, cached results. Nothing here knows a sensor or a vehicle.

Read first: `parameters.settings` (a setting is declared once, and everything is made of it), `cache` (results
of stages, by the content of their inputs), `files.atomic_file` (how a file is written).
"""
