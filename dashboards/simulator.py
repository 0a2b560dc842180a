"""The simulator, for ``panel serve dashboards/simulator.py``."""

import panel as pn

from dashboards.computing import share_interpreter
from dashboards.headers import PROTECTED
from dashboards.log_limit import limit_log
from dashboards.messages import bound_messages
from dashboards.page import SimulatorPage
from dashboards.upstream.server import speed_up

limit_log()
bound_messages()
speed_up()
share_interpreter()
if pn.state.curdoc is not None:
    PROTECTED.add(pn.state.curdoc)
SimulatorPage().servable()
