"""Live: the page that shows a stream of a sensor, and its parts."""

from dashboards.pages.live.live import Live

__all__ = ["Live"]
