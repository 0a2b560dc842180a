"""Navigation: the belief side: strapdown and error-state Kalman filter, and what they assume.

In: increments of an IMU, fixes and other measurements, and a `Belief`. Out: a `Solution`: position, velocity,
attitude, biases, their covariance, innovations.

`filters` has the error models and filters, `alignment` the start, `kernels` the generated code.

Read first: `reference` (the whole filter in filterpy, as a textbook has it), `strapdown` (one step of a
navigator), `belief` (Q, R and P0 of the settings).
"""
