"""Phone: a phone as an IMU and a receiver, through a page in its browser or one of two apps."""
