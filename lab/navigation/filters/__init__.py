"""Filters: the error models, and the Kalman filters that use them: linear, unscented, smoother."""
