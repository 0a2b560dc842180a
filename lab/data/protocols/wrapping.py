"""Wrapping: counters of a device that start again from zero, continued."""

from __future__ import annotations


class WrappingCounter:
    """Continues a counter past its end.

    A step is taken as the shortest one, forwards or backwards by less than half of the modulus: where more is
    missing, the value is wrong by a multiple of the modulus.

    Parameters
    ----------
    modulus
        The number after the largest value.
    """

    def __init__(self, modulus: int) -> None:
        self._modulus = modulus
        self._last: int | None = None

    def continued(self, value: int) -> int:
        """Return the value with all starts from zero so far counted in.

        Parameters
        ----------
        value
            As the device sends it, from 0 to the modulus - 1.
        """
        if self._last is None:
            self._last = value
        else:
            half = self._modulus // 2
            self._last += (value - self._last + half) % self._modulus - half
        return self._last
