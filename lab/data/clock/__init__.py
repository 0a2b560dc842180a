"""Clock: from stamps, counters and times of arrival to seconds, with rate, offset, steps and gaps."""
