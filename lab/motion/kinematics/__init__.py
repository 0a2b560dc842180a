"""Kinematics: curves of position and attitude, and what a perfect IMU measures on them."""
