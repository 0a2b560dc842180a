"""Missions: the page to choose, manage and create missions."""

from dashboards.pages.missions.missions import Missions

__all__ = ["Missions"]
