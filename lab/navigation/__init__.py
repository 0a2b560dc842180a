"""Navigation: strapdown, error models, error-state Kalman filter, and the navigator that combines them."""
