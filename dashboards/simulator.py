"""The simulator, for ``panel serve dashboards/simulator.py``."""

from dashboards.log_limit import limit_log
from dashboards.messages import bound_messages
from dashboards.page import SimulatorPage

limit_log()
bound_messages()
SimulatorPage().servable()
