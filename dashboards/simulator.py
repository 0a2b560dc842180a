"""The simulator, for ``panel serve dashboards/simulator.py``."""

from dashboards.page import SimulatorPage

SimulatorPage().servable()
