"""The process of the command line: what is set before anything is loaded, and what happens to whatever is raised."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import click

COMPLETION = "_MBM_COMPLETE"
"""Environment variable by which a shell asks what may come next (Click's protocol)."""

OK, ATTENTION, WRONG, INTERRUPTED = 0, 1, 2, 130
"""What the process says when it ends (CONTRACT §1)."""

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Read when NumPy is first imported. One thread unless the environment says otherwise: the matrices are narrow, where
more threads only wait for one another (twice the time for 400,000 × 13 on two cores), and sums keep their order."""

COLLECTED = 100_000
"""Containers made before cycles are looked for (Python: 700). Loading the modules of a command makes some 60,000, all
of which stay: a tenth of a warm start went into looking at them time and again."""


def main() -> int:
    """The command line of this process, whose exit status it answers.

    A terminal that cannot show a character (``±`` in ASCII) gets a question mark, not a failure; where an output was
    closed by whoever started the process, what is said goes nowhere.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123 - until the process ends
    gc.set_threshold(COLLECTED, *gc.get_threshold()[1:])
    completion = os.environ.get(COMPLETION)
    if completion:
        from click.shell_completion import shell_complete

        from mbm.cli.group import cli

        sys.exit(shell_complete(cli, {}, "mbm", COMPLETION, completion))
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    for variable in BLAS_THREADS:
        os.environ.setdefault(variable, "1")
    return run(sys.argv[1:])


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
        import click

        from mbm.cli.group import cli

        with cli.make_context("mbm", list(arguments)) as context:
            status = cli.invoke(context)
    except KeyboardInterrupt:  # first: it may come before Click is there
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except click.exceptions.Exit as leave:
        return leave.exit_code
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
    import click

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
