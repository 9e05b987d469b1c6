"""The process of the command line: what is set before anything is loaded, and what happens to whatever is raised."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from mbm.cli.output import open_closed_streams, say_error
from mbm.cli.statuses import INTERRUPTED, WRONG
from mbm.files.journal import Journal, noting

if TYPE_CHECKING:
    import click

COMPLETION = "_MBM_COMPLETE"
"""Environment variable by which a shell asks what may come next (Click's protocol)."""

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Read when NumPy is first imported. One thread unless the environment says otherwise: the matrices are narrow, where
more threads only wait for one another (twice the time for 400,000 × 13 on two cores), and sums keep their order."""

COLLECTED = 100_000
"""Containers made before cycles are looked for (Python: 700). Loading the modules of a command makes some 60,000, all
of which stay: a tenth of a warm start went into looking at them time and again."""


def main(*, heard: bool = False) -> int:
    """The command line of this process, whose exit status it answers; interrupts are ``heard`` from here on."""
    open_closed_streams()
    gc.set_threshold(COLLECTED, *gc.get_threshold()[1:])
    for variable in BLAS_THREADS:
        os.environ.setdefault(variable, "1")
    asked = os.environ.get(COMPLETION)
    try:
        if heard:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        return completed(asked) if asked else run(sys.argv[1:])
    except KeyboardInterrupt:  # while something else was said
        return INTERRUPTED


def completed(asked: str) -> int:
    """Answers a shell that asks what may come next."""
    return _guarded(partial(_complete, asked), (), Journal())


def run(arguments: Sequence[str]) -> int:
    """Runs a command line and answers its exit status; whatever goes wrong is said on standard error."""
    journal = Journal()
    with noting(journal):
        return _guarded(partial(_invoke, arguments, journal), arguments, journal)


def _complete(asked: str) -> int:
    from mbm.cli.group import complete

    return complete(COMPLETION, asked)


def _invoke(arguments: Sequence[str], journal: Journal) -> object:
    from mbm.cli.group import cli

    odd = next((argument for argument in arguments if "\0" in argument), None)
    if odd is not None:  # Click would hand it to the file system, which raises what is no mistake of a file
        from mbm.cli.faults import bad_call
        from mbm.text.faults import shown
        from mbm.text.types import MbmError

        raise MbmError(bad_call(f"`{shown(odd)}` holds a NUL, which no file name and no value can", "mbm"))

    with cli.make_context("mbm", list(arguments), obj=journal) as context:
        return cli.invoke(context)


def _guarded(call: Callable[[], object], arguments: Sequence[str], journal: Journal) -> int:
    """Click's own ``main`` is left out: it would answer a closed pipe with 1, which means something else here."""
    try:
        import click

        status = call()
    except KeyboardInterrupt:  # first: it may come before Click is there
        say_error("interrupted")
        return INTERRUPTED
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except click.exceptions.NoArgsIsHelpError as error:
        say_error(error.format_message())
        return WRONG
    except click.ClickException as error:
        return _report_click(error, arguments, journal)
    except Exception as error:  # noqa: BLE001 - the last resort: nobody gets a traceback for it
        return _report(error, arguments, journal)
    return status if isinstance(status, int) else 0


def _report(error: Exception, arguments: Sequence[str], journal: Journal) -> int:
    """Says the diagnostics of an MbmError; anything else is a fault of ours."""
    from mbm.cli import faults
    from mbm.cli.failure import print_diagnostics, report_failure
    from mbm.text.types import MbmError

    try:
        if isinstance(error, MbmError):
            report_failure(error.diagnostics, arguments, journal)
        else:
            report_failure((faults.internal_fault(error),), arguments, journal, error)
    except Exception as another:  # noqa: BLE001 - a fault while one is told: nobody gets a traceback for it either
        print_diagnostics((faults.internal_fault(another),), color=False)
    return WRONG


def _report_click(error: click.ClickException, arguments: Sequence[str], journal: Journal) -> int:
    import click

    from mbm.cli import faults
    from mbm.cli.failure import report_failure

    context = error.ctx if isinstance(error, click.UsageError) else None
    command = "mbm" if context is None else context.command_path
    message = " ".join(error.format_message().split())  # click lists choices on lines of their own
    report_failure((faults.bad_call(message, command),), arguments, journal)
    return WRONG
