"""``mbm`` and its commands, as Click takes them. Loads a command only when it is called.

What a shell is told when it asks what may come next on a command line (Click's protocol).
"""

from __future__ import annotations

from importlib import import_module

import click
from click.shell_completion import get_completion_class

from mbm.cli.options import verbosity_options, version_option
from mbm.cli.output import write_bytes
from mbm.version import __version__

UNKNOWN = 1


def complete(variable: str, asked: str) -> int:
    """Answer a shell; the exit status.

    Args:
        variable: the environment variable by which it asks.
        asked: what that holds: ``SHELL_source`` or ``SHELL_complete``.

    Raises:
        MbmError: standard output cannot be written.

    """
    shell, _, instruction = asked.partition("_")
    kind = get_completion_class(shell)
    if kind is None or instruction not in ("source", "complete"):
        return UNKNOWN
    completion = kind(cli, {}, "mbm", variable)
    try:
        answer = completion.source() if instruction == "source" else f"{completion.complete()}\n"
    except (KeyError, ValueError):  # words and their number are in the environment too
        return UNKNOWN
    write_bytes(answer.encode())
    return 0


COMMANDS = {
    "solve": "Solve a problem: estimates with their uncertainties.",
    "budget": "The uncertainty of estimates, input by input.",
    "propagate": "Propagate distributions (GUM Supplement 1): intervals and samples.",
    "design": "The accuracy to expect before measuring, and what to measure next.",
    "report": "One page with all that is to be said of a solved problem.",
    "trajectory": "Errors of an aligned trajectory: of each pose, and over steps.",
    "view": "Draw models, scenes, measurements in their images, maps.",
    "simulate": "Write simulated measurements, with noise, as data files.",
    "check": "Report errors in a problem without solving it.",
    "explain": "Show the derived observation model: equations, unknowns, structure.",
    "compile": "Write a solver that needs no mbm: in C, Python or CasADi.",
    "expand": "Print the expansion of an expression.",
    "fmt": "Format source files.",
    "new": "Write a first problem that solves at once.",
    "cache": "Show or clear the cache of compiled problems.",
}
"""The commands, each the module of its name in `mbm.cli.commands`."""

LATER = ("ui", "lsp")
"""Commands of CONTRACT §1 that this version answers with one line."""


class Commands(click.Group):
    """The commands by name, imported when they are called."""

    def list_commands(self, _context: click.Context) -> list[str]:
        """Every command, in the order of the table."""
        return list(COMMANDS)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """The command of a name; raises for those of later versions and for names that are none."""
        if name in COMMANDS:
            command = import_module(f"mbm.cli.commands.{name}").command
            return command if isinstance(command, click.Command) else None
        if context.resilient_parsing:
            return None
        from mbm.cli import faults
        from mbm.text.types import MbmError

        raise MbmError(
            faults.not_available_yet(f"mbm {name}") if name in LATER else faults.unknown_command(name, COMMANDS)
        )

    def format_commands(self, _context: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands, from the table: no command is loaded for it."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=Commands, context_settings={"help_option_names": []})
@version_option(f"mbm, version {__version__}")
@verbosity_options
def cli() -> None:
    """A compiler for measurement problems: from shapes, data and observation equations to estimates with honest
    uncertainties.

    Exit status: 0 solved; 1 an answer that should not be trusted as it stands, or a file that `fmt --check` would
    change; 2 the problem, the data or the call is wrong.
    """
