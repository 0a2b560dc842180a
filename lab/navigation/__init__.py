"""Navigation: strapdown, error models, the error-state Kalman filter, and the navigator made of them."""
