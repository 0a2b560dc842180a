"""App: the common part of all commands: help, execution, and the messages for errors."""

from __future__ import annotations

import atexit
import contextlib
import gc
import json
import sys
from collections.abc import Iterator
from importlib import import_module
from typing import Annotated, Any

import typer

from lab.base.blas_threads import OneBlasThread
from lab.base.collection_pause import collection_pause
from lab.base.files.mission_error import MissionError
from lab.base.parameters.setting_error import SettingError
from lab.base.plain_data import to_plain_data
from lab.base.progress import StoppedError
from lab.cli.interrupt import STOPPED
from lab.cli.terminal import (
    ProgressLine,
    drop_output,
    say_starting,
    spell_what_cannot_be_encoded,
    visible_output,
)


class CommandError(ValueError):
    """A command with invalid arguments; the message says what is accepted."""


@contextlib.contextmanager
def writing(path: object, option: str = "") -> Iterator[None]:
    """Write a file that an option names; `CommandError` if it cannot be written."""
    try:
        yield
    except OSError as error:
        where = f"{option} {path}".strip()
        raise CommandError(f"{where}: cannot be written: {error.strerror or error}") from error


class Commands(typer.core.TyperGroup):
    """The commands; an error that a person can correct gives a message instead of a traceback."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by its name."""
        command = super().get_command(ctx, cmd_name)
        if command is None and not ctx.resilient_parsing:
            raise CommandError(
                f"there is no command {cmd_name!r}; accepted: {', '.join(self.list_commands(ctx))}"
            )
        return command

    def invoke(self, ctx: Any) -> Any:
        """Carry out the command."""
        try:
            answer = super().invoke(ctx)
            sys.stdout.flush()  # what cannot be written is reported here, not when Python ends
        except (CommandError, MissionError, SettingError, StoppedError) as error:
            print(f"ins-lab: {error}", file=sys.stderr)
            raise typer.Exit(STOPPED if isinstance(error, StoppedError) else 2) from error
        except OSError as error:
            if isinstance(error, BrokenPipeError):  # whoever reads has enough
                raise
            if error.filename is None:  # the system names no file when the disk is full
                drop_output()
            print(
                f"ins-lab: {error.filename or 'standard output'}: {error.strerror or error}", file=sys.stderr
            )
            raise typer.Exit(2) from error
        return answer


COMMANDS: dict[str, tuple[str, str]] = {}
"""The commands in the order of the help: the function or group of each, as ``"module:name"``, and its
summary."""


class AllCommands(Commands):
    """The commands of `COMMANDS`; each is imported when it is asked for, so that help appears at once."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by its name, imported now."""
        if cmd_name in COMMANDS and cmd_name not in self.commands:
            if ctx and not ctx.resilient_parsing:
                say_starting()
            self.commands[cmd_name] = _import_command(cmd_name)
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the names and summaries of all commands."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary) for name, (_, summary) in COMMANDS.items()])


def _import_command(name: str) -> Any:
    module, _, attribute = COMMANDS[name][0].partition(":")
    with collection_pause():
        home = import_module(module)
    found = getattr(home, attribute)
    if isinstance(found, typer.Typer):
        group = typer.main.get_group(found)
        group.epilog = home.EXAMPLES
        return group
    alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    alone.command(name, epilog=getattr(home, "EXAMPLES", None))(found)
    return typer.main.get_command(alone)


def option(name: str, form: str, text: str, default: str = "", **limits: Any) -> Any:
    """Return an option; its help shows no default, or the words for it.

    Parameters
    ----------
    name, form
        As it is written: the option, and what follows it.
    text
        What it does.
    default
        What happens without it, in words.
    **limits
        Further arguments of `typer.Option`, such as ``min``.
    """
    return typer.Option(name, metavar=form, help=text, show_default=default or False, **limits)


def argument(form: str, text: str) -> Any:
    """Return an argument; its help shows no default."""
    return typer.Argument(metavar=form, help=text, show_default=False)


def group(name: str, commands: type[Commands] = Commands) -> typer.Typer:
    """Return a command of commands, with the summary of its row in `COMMANDS`; alone, it shows its help.

    Parameters
    ----------
    name
        Its name.
    commands
        Its class.
    """
    return typer.Typer(
        name=name,
        cls=commands,
        help=COMMANDS[name][1],
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        no_args_is_help=True,
    )


app = typer.Typer(
    name="ins-lab",
    cls=AllCommands,
    invoke_without_command=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="""\b
Examples:
  ins-lab missions
  ins-lab run montreal
  ins-lab run montreal --set sensors.gyro.noise_density=0.02 --seed 7
  ins-lab budget montreal
  ins-lab cards
  ins-lab serve""",
)


def main() -> None:
    """Run the command line with the arguments of the process."""
    atexit.register(gc.freeze)  # or Python searches all that was imported for garbage as it ends: 0.15 s
    spell_what_cannot_be_encoded()
    with visible_output():
        app(prog_name="ins-lab")


@app.callback()
def ins_lab(
    ctx: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
) -> None:
    """INS Lab: fly a mission, simulate the sensors, navigate, and see how good the solution is, and why."""
    if version:
        from importlib.metadata import version as installed  # noqa: PLC0415 - rarely needed

        print(f"ins-lab {installed('ins-lab')}")
    elif ctx.invoked_subcommand is None:
        print(ctx.get_help())


@contextlib.contextmanager
def working(task: str) -> Iterator[ProgressLine]:
    """Report progress; only the answer goes to standard output, whatever a library prints.

    Parameters
    ----------
    task
        Subject of the work, such as the mission; it precedes an error message that does not name it.

    Raises
    ------
    CommandError
        In place of a `ValueError` without a message of the lab, and of a `MemoryError`.
    """
    with contextlib.redirect_stdout(sys.stderr), OneBlasThread(), ProgressLine(task) as progress:
        try:
            yield progress
        except (CommandError, MissionError, SettingError, StoppedError):
            raise
        except ValueError as error:
            raise CommandError(f"{task}: {error}") from error
        except MemoryError as error:
            raise CommandError(
                f"{task}: needs more memory than is available; a shorter flight or a lower "
                "trajectory.imu_rate needs less"
            ) from error


def print_json(data: Any) -> None:
    """Print data as JSON, which any encoding can write."""
    print(json.dumps(to_plain_data(data), indent=2, allow_nan=False))
