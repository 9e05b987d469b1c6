"""``mbm``: the list of commands, and what happens to whatever they raise. Loads a command only when it is called."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from io import TextIOWrapper

import click

from mbm.cli.options import verbosity_options
from mbm.version import __version__

COMMANDS = {
    "solve": "Solve a problem: estimates with their uncertainties.",
    "simulate": "Make the measurements that the model predicts, with noise, as data files.",
    "check": "Find what is wrong with a problem without solving it.",
    "explain": "Show the derived observation model: equations, unknowns, structure.",
    "compile": "Write a solver that needs no mbm: in C, Python or CasADi.",
    "expand": "Show the form that a form expands to.",
    "fmt": "Lay the source out.",
    "new": "Write a first problem that solves at once.",
    "cache": "Show or clear what was compiled earlier.",
}
"""The commands, each the module of its name in `mbm.cli.commands`."""

LATER = ("design", "view", "ui", "lsp")
"""Commands of CONTRACT §1 that this version answers with one line."""

COMPLETION = "_MBM_COMPLETE"
"""Environment variable by which a shell asks what may come next (Click's protocol)."""

INTERRUPTED = 130
WRONG = 2


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


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mbm")
@verbosity_options
def cli() -> None:
    """A compiler for measurement problems: from shapes, data and observation equations to estimates with honest
    uncertainties.

    Exit status: 0 solved; 1 an answer that should not be trusted as it stands, or a file that `fmt --check` would
    change; 2 the problem, the data or the call is wrong.
    """


BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Read when NumPy is first imported. One thread unless the environment says otherwise: the matrices are narrow, where
more threads only wait for one another (twice the time for 400,000 × 13 on two cores), and sums keep their order."""


def main() -> None:
    """The entry point: runs the command line of this process and ends it.

    A terminal that cannot show a character (``±`` in ASCII) gets a question mark, not a failure.
    """
    completion = os.environ.get(COMPLETION)
    if completion:
        from click.shell_completion import shell_complete

        sys.exit(shell_complete(cli, {}, "mbm", COMPLETION, completion))
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    for variable in BLAS_THREADS:
        os.environ.setdefault(variable, "1")
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Runs a command line and answers its exit status; whatever goes wrong is said on standard error."""
    try:
        status = _guarded(arguments)
        sys.stdout.flush()
    except BrokenPipeError:
        _discard_output()
        return 0
    return status


def _guarded(arguments: Sequence[str]) -> int:
    """Click's own ``main`` is left out: it would answer a closed pipe with 1, which means something else here."""
    try:
        with cli.make_context("mbm", list(arguments)) as context:
            status = cli.invoke(context)
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message(), file=sys.stderr)
        return WRONG
    except click.ClickException as error:
        return _report_click(error, arguments)
    except BrokenPipeError:
        raise
    except Exception as error:  # noqa: BLE001 - the last resort: nobody gets a traceback for it
        return _report(error, arguments)
    return status if isinstance(status, int) else 0


def _report(error: Exception, arguments: Sequence[str]) -> int:
    """Says the diagnostics of an MbmError; anything else is a fault of ours."""
    from mbm.cli import faults
    from mbm.cli.failure import report_failure
    from mbm.text.types import MbmError

    if isinstance(error, MbmError):
        report_failure(error.diagnostics, arguments)
    else:
        report_failure((faults.internal_fault(error),), arguments, error)
    return WRONG


def _report_click(error: click.ClickException, arguments: Sequence[str]) -> int:
    from mbm.cli import faults
    from mbm.cli.failure import report_failure

    context = error.ctx if isinstance(error, click.UsageError) else None
    command = "mbm" if context is None else context.command_path
    message = " ".join(error.format_message().split())  # click lists choices on lines of their own
    report_failure((faults.bad_call(message, command),), arguments)
    return WRONG


def _discard_output() -> None:
    """Nobody reads any more: lets the interpreter's last flush go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
