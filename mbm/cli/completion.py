"""What a shell is told when it asks what may come next on a command line (Click's protocol)."""

from __future__ import annotations

from click.shell_completion import get_completion_class

from mbm.cli.group import cli
from mbm.cli.output import write_bytes

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
