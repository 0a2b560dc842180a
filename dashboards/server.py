"""Server: the laboratory on one port of this computer."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

APP = Path(__file__).with_name("simulator.py")


def serve(
    port: int = 5006, address: str = "127.0.0.1", show: bool = False, algorithms: Sequence[str] = ()
) -> None:
    """Serve the simulator until interrupted; the 3-D view goes through the same port.

    Parameters
    ----------
    port
        Port to listen on.
    address
        Address to listen on; ``"0.0.0.0"`` is all of this computer's.
    show
        Whether to open the page in a browser.
    algorithms
        Algorithms of whoever serves, as ``FILE.py:Name``, compared beside the built-in models.
    """
    import panel as pn  # noqa: PLC0415 - takes a second

    from dashboards.algorithms import VARIABLE  # noqa: PLC0415 - takes a second

    if algorithms:
        os.environ[VARIABLE] = ",".join(algorithms)
    import dashboards.page  # noqa: F401, PLC0415 - so that the first visitor does not wait for it
    from dashboards.headers import SecurityHeaders  # noqa: PLC0415 - beside what it goes with

    # Listening on all addresses, the names under which this computer is reached are not known here.
    loopback = address in {"127.0.0.1", "localhost"}
    origins = [f"{name}:{port}" for name in ("localhost", "127.0.0.1")] if loopback else ["*"]
    where = "localhost" if loopback else address
    print(f"INS Lab is at http://{where}:{port}/ (stop it with Ctrl-C)", flush=True)
    pn.serve(
        {"/": str(APP)},
        port=port,
        address=address,
        websocket_origin=origins,
        show=show,
        title="INS Lab",
        verbose=False,
        transforms=[SecurityHeaders],
    )
