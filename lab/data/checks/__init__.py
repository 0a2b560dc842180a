"""Checks: whether force, rates, course, velocity, heights and headings contradict each other.

In: the columns of a flight or a log. Out: what contradicts what, where, and the unit, sign or order that
explains it. Callers choose words and consequences: `lab.data.rebuild.plausibility` of flights, `log_check` of
logs, also of recorded streams, `lab.analysis.identification.log_faults` of a run. All limits are in `limits`.

| file | decides | from |
|---|---|---|
| `path_check` | unit, sign and order of velocities, heights and positions | displacement, velocity |
| `attitude_check` | heading, roll, pitch, rates of a flight | course, turns, slope, specific force |
| `gyro_check` | signs and order of gyros and accelerometers | velocity, force and rates; course, rates |
| `log_check` | unit of force and rates, axes, clocks | gravity; course and speed, rates and force |
| `auxiliary_check` | barometer, odometer, airspeed, headings of a log | heights, speeds, turns |
| `full_scale`, `estimator_resets` | ends of ranges; jumps of a solution | the column alone |

Two series are compared by `likeness`, an IMU with velocities by `velocity_matching`.
"""
