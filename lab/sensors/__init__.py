"""Sensors: simulated measurements of an IMU and a GPS receiver."""
