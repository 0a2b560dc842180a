"""Cards: the functions that draw the cards in a notebook.

`import lab` registers them. To keep that fast, a drawing function is imported when its first card is drawn.
"""

from __future__ import annotations

from typing import Any

from lab.notebook_card import register


def _settings(settings: Any) -> str:
    from lab.views.settings_card import settings_html  # noqa: PLC0415 - see above

    return settings_html(settings)


def _result(result: Any) -> str:
    from lab.views.result_card import result_html  # noqa: PLC0415 - see above

    return result_html(result)


def _mission(mission: Any) -> str:
    from lab.views.mission_card import mission_html  # noqa: PLC0415 - see above

    return mission_html(mission)


def _log(mission: Any) -> str:
    from lab.views.mission_card import log_html  # noqa: PLC0415 - see above

    return log_html(mission)


def _outcome(outcome: Any) -> str:
    from lab.views.outcome_card import outcome_html  # noqa: PLC0415 - see above

    return outcome_html(outcome)


def register_cards() -> None:
    """Register all cards."""
    register("settings", _settings)
    register("result", _result)
    register("mission", _mission)
    register("log", _log)
    register("outcome", _outcome)
