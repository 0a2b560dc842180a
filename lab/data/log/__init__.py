"""Logs: recordings of an IMU and a GPS receiver on a vehicle, and of other sensors.

In: csv files and their ``log.toml``. Out: a `SensorLog`, repaired and checked against gravity and the fixes.
"""
