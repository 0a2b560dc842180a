"""X-Plane: a running X-Plane as the truth of a flight, with simulated sensors in its aircraft."""
