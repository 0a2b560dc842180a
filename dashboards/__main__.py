"""``python -m dashboards`` is ``ins-lab``."""

from dashboards.command_line import main

if __name__ == "__main__":
    main()
