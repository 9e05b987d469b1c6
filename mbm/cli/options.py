"""Options that every command takes, and the settings of the terminal that follow from them."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, TextIO, TypeVar

import click

from mbm.values import dataclass

WIDEST_TABLE, NARROWEST = 100, 60
_Function = TypeVar("_Function", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True, kw_only=True)
class Terminal:
    """How to talk: ``quiet`` drops all but results and errors, ``verbose`` adds what is usually left out."""

    quiet: bool
    verbose: bool
    color: bool
    color_errors: bool
    width: int

    @property
    def shows_progress(self) -> bool:
        """Standard error is a terminal, and nobody asked for silence."""
        return not self.quiet and sys.stderr.isatty()


def verbosity_options(function: _Function) -> _Function:
    """``-q``, ``-v``, ``--no-color``, before the command and behind it; they reach it through `terminal`."""
    for option in (
        click.option("--no-color", is_flag=True, expose_value=False, callback=_remember, help="No colours."),
        click.option("-v", "--verbose", is_flag=True, expose_value=False, callback=_remember, help="Say more."),
        click.option("-q", "--quiet", is_flag=True, expose_value=False, callback=_remember, help="Say less."),
    ):
        function = option(function)
    return function


def terminal() -> Terminal:
    """The settings of the command that runs."""
    asked = click.get_current_context().meta
    colors = not asked.get("mbm.no_color", False)
    return Terminal(
        quiet=asked.get("mbm.quiet", False),
        verbose=asked.get("mbm.verbose", False),
        color=colors and colorful(sys.stdout),
        color_errors=colors and colorful(sys.stderr),
        width=max(NARROWEST, min(WIDEST_TABLE, _columns())),
    )


def _columns() -> int:
    """The width of the terminal; `shutil.get_terminal_size` answers the same, but loads what unpacks archives."""
    stated = os.environ.get("COLUMNS", "")
    if stated.isdecimal() and int(stated) > 0:
        return int(stated)
    try:
        return os.get_terminal_size(sys.__stdout__.fileno()).columns or WIDEST_TABLE if sys.__stdout__ else WIDEST_TABLE
    except (OSError, ValueError):  # no terminal, or closed
        return WIDEST_TABLE


def colorful(stream: TextIO) -> bool:
    """The stream is a terminal that shows colours, and NO_COLOR (no-color.org) is not set."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _remember(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value:
        context.meta[f"mbm.{parameter.name}"] = True
