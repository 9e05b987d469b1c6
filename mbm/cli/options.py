"""Options that every command takes, and the settings of the terminal that follow from them."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mbm.cli.output import is_terminal, say, shows_colors
from mbm.files.journal import THE_PROBLEM, Journal, Read, note, noting
from mbm.values import dataclass

WIDEST_TABLE, NARROWEST = 100, 60
_DIGITS = 9
"""Of a width that is looked at: Python reads no number of thousands of digits."""
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
        return not self.quiet and is_terminal(sys.stderr)


if TYPE_CHECKING:
    _Type = click.ParamType[int | float]
else:
    _Type = click.ParamType  # no generic class before click 8.3


class NumberFrom(_Type):
    """A number from ``least`` to ``most``, a ``whole`` one unless it says otherwise; 1e3 is whole, too."""

    name = "number"

    def __init__(self, least: float = -math.inf, most: float = math.inf, *, whole: bool = True) -> None:
        self.least, self.most, self.whole = least, most, whole

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> int | float:
        """The number; a message about the option where it is none."""
        try:
            found: int | float = int(value) if self.whole and str(value).isdecimal() else float(value)
        except ValueError:
            found = math.nan
        if self.whole and isinstance(found, float) and found.is_integer():
            found = int(found)
        if not self.least <= found <= self.most or (self.whole and not isinstance(found, int)):
            ends = f" from {self.least:g}" if self.least > -math.inf else ""
            ends += f" to {self.most:g}" if self.most < math.inf else ""
            self.fail(f"`{value}` is no {'whole ' if self.whole else ''}number{ends}", parameter, context)
        return found


def verbosity_options(function: _Function) -> _Function:
    """``-q``, ``-v``, ``--no-color``, before the command and behind it; they reach it through `terminal`. And help."""
    for option in (
        _told("-h", "--help", text=lambda context: context.get_help(), help="Show this message and exit."),
        click.option("--no-color", is_flag=True, expose_value=False, callback=_remember, help="No colours."),
        click.option("-v", "--verbose", is_flag=True, expose_value=False, callback=_remember, help="Say more."),
        click.option("-q", "--quiet", is_flag=True, expose_value=False, callback=_remember, help="Say less."),
    ):
        function = option(function)
    return function


def allow_external_option(function: _Function) -> _Function:
    """``--allow-external``, of the commands that may call what a problem names."""
    text = "Let FILE import and call the functions in Python that it names."
    return click.option("--allow-external", is_flag=True, help=text)(function)


def terminal() -> Terminal:
    """The settings of the command that runs."""
    asked = click.get_current_context().meta
    colors = not asked.get("mbm.no_color", False)
    return Terminal(
        quiet=asked.get("mbm.quiet", False),
        verbose=asked.get("mbm.verbose", False),
        color=colors and shows_colors(sys.stdout),
        color_errors=colors and shows_colors(sys.stderr),
        width=max(NARROWEST, min(WIDEST_TABLE, _columns())),
    )


def _columns() -> int:
    """The width of the terminal; `shutil.get_terminal_size` answers the same, but loads what unpacks archives."""
    stated = os.environ.get("COLUMNS", "")
    if stated.isdecimal() and stated.strip("0"):
        return int(stated) if len(stated) <= _DIGITS else WIDEST_TABLE
    try:
        return os.get_terminal_size(sys.__stdout__.fileno()).columns or WIDEST_TABLE if sys.__stdout__ else WIDEST_TABLE
    except (OSError, ValueError):  # no terminal, or closed
        return WIDEST_TABLE


def version_option(text: str) -> Callable[[_Function], _Function]:
    """``--version``, which says ``text``."""
    return _told("--version", text=lambda _context: text, help="Show the version and exit.")


def _told(*names: str, text: Callable[[click.Context], str], help: str) -> Callable[[_Function], _Function]:  # noqa: A002 - as Click calls it
    """An option that says a text and ends the call."""

    def tell(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
        if value and not context.resilient_parsing:
            say(text(context))
            context.exit()

    return click.option(*names, is_flag=True, is_eager=True, expose_value=False, callback=tell, help=help)


def problem_at(path: Path) -> tuple[Read, ...]:
    """The problem file of a call as one that was read, before it is."""
    journal = Journal()
    with noting(journal):
        note(path, THE_PROBLEM)
    return journal.reads()


def reads_so_far() -> tuple[Read, ...]:
    """The files that this call has read."""
    journal = click.get_current_context().find_object(Journal)
    return () if journal is None else journal.reads()


def _remember(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value:
        context.meta[f"mbm.{parameter.name}"] = True
