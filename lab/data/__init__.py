"""Data: what devices and programs wrote or send becomes one table of readings, on one clock, checked.

In: files of any known format, and bytes of devices as they come. Out: a `SensorLog` (IMU, fixes and other
readings) or a `Recording` (a flight rebuilt from it), with a report on what was repaired and assumed.

The folders, each built on those before it: `clock` (stamps to seconds), `log` (the table of what was
measured), `checks` (whether its numbers contradict each other), `rebuild` (a flight from samples), `files`
and `sheets` (formats, and csv of unknown origin; `formats` chooses), `protocols` (messages of devices),
`streams` (what arrives).

Read first: `log.sensor_log`, `formats` (how the format of a file is found), `streams.source`.
"""
