"""Error models by their number of states."""

from __future__ import annotations

from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ErrorModel
from lab.navigation.filters.further_columns import with_blocks


def with_states(model: ErrorModel, states: int) -> ErrorModel:
    """Return a model of 15 states as one of 15 or 21 states: the scale factors are random constants."""
    return with_blocks(model, blocks.SCALES if states > blocks.CORE else ())
