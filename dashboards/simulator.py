"""The simulator, for ``panel serve dashboards/simulator.py``."""

import panel as pn
from tornado.ioloop import IOLoop

from dashboards.browser import REMEMBERED
from dashboards.computing import share_interpreter
from dashboards.headers import PROTECTED
from dashboards.log_limit import limit_log
from dashboards.messages import bound_messages
from dashboards.openings import LEFT, may_not_end
from dashboards.page import SimulatorPage
from dashboards.upstream.component_files import PACKAGES, give_files_of_loaded_components
from dashboards.upstream.exits import outlive_exits
from dashboards.upstream.page_address import read_any_address
from dashboards.upstream.refused_values import refuse_values
from dashboards.upstream.server import end_left_pages, speed_up
from lab.run.memory import keep_few_freed_blocks

give_files_of_loaded_components(PACKAGES)
outlive_exits(IOLoop.current())
read_any_address()
limit_log()
bound_messages()
refuse_values()
speed_up()
end_left_pages(LEFT, may_not_end)
share_interpreter()
keep_few_freed_blocks()
if pn.state.curdoc is not None:
    PROTECTED.add(pn.state.curdoc)
    REMEMBERED.add(pn.state.curdoc)
SimulatorPage().servable()
