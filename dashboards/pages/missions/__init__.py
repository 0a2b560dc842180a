"""Missions: the page on which missions are chosen, looked after and made."""

from dashboards.pages.missions.missions import Missions

__all__ = ["Missions"]
