"""``ins-lab figure``: a plot of a run as PDF, SVG or PNG, as a journal takes it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lab.cli import options
from lab.cli.app import CommandError, option, working, writing
from lab.views.cards import PLOTS

ENDINGS = (".pdf", ".svg", ".png")

EXAMPLES = """\b
Examples:
  ins-lab figure montreal --to errors.pdf --width "88 mm"
  ins-lab figure montreal --plot ground_track --to path.svg
  ins-lab figure montreal --plot covariance --set navigator.q_scale=10 --to sigma.png --width "180 mm"
Fonts are embedded, and curves differ in line style, too, so that they can be told apart in grey."""


def figure(
    mission: options.Mission,
    to: Annotated[Path, option("--to", "FILE", f"File to write, ending in {', '.join(ENDINGS)}.")],
    plot: Annotated[
        str, typer.Option("--plot", metavar="NAME", help=f"What it shows: {', '.join(PLOTS)}.")
    ] = PLOTS[0],
    width: Annotated[
        str | None,
        option(
            "--width",
            "LENGTH",
            'Such as "88 mm", "8.8 cm", "3.5 in", "252 pt"; 88 mm for one panel, 180 mm for several.',
        ),
    ] = None,
    height: Annotated[
        str | None, option("--height", "LENGTH", "Likewise; what the panels need by default.")
    ] = None,
    config: options.Config = None,
    card: options.Card = None,
    assumed: options.Assumed = True,
    assignments: options.Assignments = None,
    seed: options.Seed = None,
    own: options.AlgorithmFile = None,
    force: options.Force = False,
) -> None:
    """Write a plot of a run as a figure for print: PDF, SVG or PNG."""
    options.check_out(to, force, ENDINGS, "a figure", "--to")
    if plot not in PLOTS:
        raise CommandError(f"--plot {plot[:40]}: accepted are {', '.join(PLOTS)}")
    from lab.views.paper_figure import millimetres  # noqa: PLC0415 - help does not need it

    try:
        for name, length in (("--width", width), ("--height", height)):
            if length is not None:
                millimetres(length, name)
    except ValueError as error:
        raise CommandError(str(error)) from error
    chosen = options.experiment(mission, config, card, assignments, seed, assumed)
    with working(chosen.mission) as progress:
        result = chosen.run(progress, algorithm=options.algorithm(own))
        if reason := result.missing_reason(plot):
            raise CommandError(f"--plot {plot}: {reason} Accepted are {', '.join(dir(result.plot))}")
        with writing(to, "--to"):
            getattr(result.plot, plot)().save(to, width, height=height, overwrite=force)
    print(to)
