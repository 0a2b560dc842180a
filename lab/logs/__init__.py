"""Logs: what an IMU and a GPS receiver recorded on a vehicle, and what else was measured.

In: csv files and their ``log.toml``. Out: a `SensorLog`, repaired and checked against gravity and the fixes.
"""
