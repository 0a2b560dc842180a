"""Own room: where the states that a user declared are in the state of a navigator, behind all others.

Only a navigator that has such states has this room. Their effects on the sensors are computed in each step
and kept for the error model.
"""

from __future__ import annotations

from lab.navigation import strapdown

MOST = 12
"""Most states that a user may declare: their number only costs memory here."""
WIDTH = 6
"""Numbers of the effect of a state: on three gyros, then on three accelerometers."""
VALUES = strapdown.LENGTH + 18
"""Their estimates, in SI units, behind the values of a wander-azimuth navigator (`wander.LENGTH`)."""
EFFECTS = VALUES + MOST
"""The effects of one after the other, in the order of the states of the filter."""
END = EFFECTS + WIDTH * MOST
"""Length of the state."""
