"""Live: streams of real sensors, decoded as they arrive."""
