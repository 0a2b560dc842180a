"""Sensors: what an IMU and a GPS receiver make of the truth."""
