"""Simulated: a device that flies a mission, sends as a real one does, and misbehaves when told to."""
