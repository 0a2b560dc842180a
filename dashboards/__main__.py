"""``python -m dashboards`` is ``ins-lab``."""

from dashboards.command_line import main

main()
