"""The address of the page follows changes of settings so soon that a reload keeps them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from walking import walking

from dashboards.address import AT_ONCE, PERIOD, SOON


class Document:
    """Notes when callbacks are due [ms]."""

    def __init__(self) -> None:
        self.due: list[int] = []

    def add_timeout_callback(self, _callback: Callable[[], None], due: int) -> None:
        """Note when it is due."""
        self.due.append(due)


def test_a_change_is_in_the_address_before_its_result_and_many_changes_are_few_updates() -> None:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as walk:
        address, session = walk.page._address, walk.page.session

        address._document = Document()
        address._write()
        address._updates.clear()
        session.change("sensors.gyro.noise_density", 0.2)
        assert address._document.due == [SOON]
        session.change("sensors.gyro.noise_density", 0.3)
        assert address._document.due == [SOON]
        address._write()
        assert "sensors.gyro.noise_density=0.3" in address.search
        session.change("sensors.gyro.noise_density", 0.4)
        session.change("sensors.gyro.noise_density", 0.5)
        assert address._document.due == [SOON, SOON]  # a second change soon after the first is kept too
        address._write()
        assert "sensors.gyro.noise_density=0.5" in address.search
        for k in range(2 * AT_ONCE):  # a slider that is moved
            session.change("sensors.gyro.noise_density", 0.6 + k / 100)
            address._write()
        assert address._document.due[-AT_ONCE:] == [PERIOD] * AT_ONCE
