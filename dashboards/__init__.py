"""Dashboards: the pages of the laboratory in a browser; layout and state of a session, no physics."""

from dashboards.server import serve

__all__ = ["serve"]
