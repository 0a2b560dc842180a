"""Motion: the truth. A recorded flight becomes one twice-differentiable curve, and a perfect IMU on it.

In: a flight csv, or the samples of a flight. Out: a `Recording`; a `Trajectory` with position, velocity,
attitude, angular rate and specific force at any time; the increments of an ideal IMU.

Read first: `truth.trajectory` (the curve), `kinematics.ideal_imu` (what a perfect IMU measures on it),
`frames.earth` (the one ellipsoid, gravity and Earth rate of the lab).
"""
