"""Addresses: names of modules for the parts of an address that could name one.

Each of these does something when it is imported: it ends the process, opens a browser, prints, or starts a
command.
"""

MODULES = (
    "dashboards.__main__", "dashboards.simulator", "unittest.__main__", "antigravity", "this", "pip.__main__",
    "lab.cli", "idlelib.idle", "os", ".", "..", "dashboards..x", "numpy.f2py.__main__",
)  # fmt: skip
