"""``python -m lab.cli`` is ``ins-lab``."""

from lab.cli import main

main()
