"""Sensors: the truth side: what a real IMU, receiver, barometer, compass or odometer adds to the truth.

In: a `Trajectory`, settings of each sensor and a seed. Out: readings with errors, the same bit for bit for
the same seed.

Read first: `imu` (the equation of the errors), `imu_errors` (its settings), `cards` (data sheets as settings;
the numbers stand in `cards.toml`).
"""
