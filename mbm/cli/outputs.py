"""The files that a solve writes: looked at before the work is done, written after it, each as far as it can be."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from io import StringIO
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

from mbm.cli.documents import STANDARD_OUTPUT, refuse_standard_output
from mbm.cli.failure import print_diagnostics
from mbm.cli.options import Terminal, problem_at, reads_so_far, terminal
from mbm.cli.output import write_bytes
from mbm.cli.statuses import ATTENTION, OK, WRONG
from mbm.files.journal import Read, option_role
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.report.budgets.answer import BudgetAnswer
    from mbm.report.designs.answer import Design
    from mbm.report.propagation.answer import Propagated
    from mbm.report.trajectories.answer import TrajectoryAnswer
    from mbm.report.types import Result

_Found = TypeVar("_Found", bound="BudgetAnswer | TrajectoryAnswer | Propagated")


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A file: where it goes, what it holds of an answer, the roles for which it may have been read and be replaced."""

    path: str
    content: Callable[[Any], bytes]
    allowed: tuple[str, ...] = ()


def outputs_of(given: Mapping[str, Any]) -> tuple[Output, ...]:
    """The files that the options of ``mbm solve`` ask for.

    Raises:
        MbmError: plot-format.

    """
    found = []
    if given["json_path"] not in (None, STANDARD_OUTPUT):
        # A document may take the place of the one that it began from.
        found.append(Output(path=given["json_path"], content=document_bytes, allowed=(option_role("--init"),)))
    if given["csv_path"] is not None:
        found.append(Output(path=given["csv_path"], content=_solves))
    if given["estimates_path"] is not None:
        found.append(Output(path=given["estimates_path"], content=_estimates))
    if given["residuals_path"] is not None:
        found.append(Output(path=given["residuals_path"], content=_residuals))
    if given["plot_path"] is not None:
        found.append(Output(path=given["plot_path"], content=_picture(given["plot_path"])))
    if given["overlay_path"] is not None:
        found.append(Output(path=given["overlay_path"], content=_overlay(given["overlay_path"])))
    return tuple(found)


def check_outputs(outputs: Iterable[Output], reads: Iterable[Read]) -> None:
    """What speaks against writing, as far as can be said before there is anything to write.

    Raises:
        MbmError: not-writable, would-overwrite: all that was found.

    """
    outputs = tuple(outputs)
    if not outputs:
        return
    from mbm.files.targets import refuse_twice
    from mbm.files.writing import checked_target

    reads, targets, wrong = tuple(reads), [], list[Diagnostic]()
    for output in outputs:
        try:
            refuse_standard_output(output.path)
            targets.append(checked_target(output.path, reads=reads, allowed=output.allowed))
        except MbmError as error:
            wrong.extend(error.diagnostics)
    if wrong:
        raise MbmError(*wrong)
    refuse_twice(targets)


def write_outputs(outputs: Iterable[Output], answer: object, reads: Iterable[Read]) -> tuple[Diagnostic, ...]:
    """Write every file that can be; what went wrong with the others."""
    outputs = tuple(outputs)
    if not outputs:
        return ()
    from mbm.files.writing import write_whole

    wrong: list[Diagnostic] = []
    for output in outputs:
        try:
            write_whole(output.path, output.content(answer), reads=reads, allowed=output.allowed)
        except MbmError as error:
            wrong.extend(error.diagnostics)
    return tuple(wrong)


def answered(
    given: Mapping[str, Any],
    outputs: Sequence[Output],
    find: Callable[[Callable[[], None]], _Found],
    show: Callable[[_Found, Terminal], None],
    beside: Callable[[_Found], Iterable[Diagnostic]] = lambda _: (),
) -> int:
    """Find an answer, write ``outputs`` of it, and say its document, where ``--json -`` asks for that, or its text.

    ``find`` calls what it is given once everything was read, before the work begins; ``show`` says the text. Warnings
    are those of the result, and those ``beside`` it.

    Returns:
        The exit status.

    Raises:
        MbmError: nothing was found, or a file would be in the way.

    """
    screen = terminal()
    check_outputs(outputs, problem_at(given["file"]))
    found = find(lambda: check_outputs(outputs, reads_so_far()))
    print_diagnostics(() if screen.quiet else (*found.result.diagnostics, *beside(found)), color=screen.color_errors)
    wrong = [*write_outputs(outputs, found, reads_so_far())]
    try:
        if given["json_path"] == STANDARD_OUTPUT:
            write_bytes(encoded(found))
        else:
            show(found, screen)
    except MbmError as error:  # the files are there, and stay
        wrong.extend(error.diagnostics)
    print_diagnostics(wrong, color=screen.color_errors)
    return WRONG if wrong else OK if found.status.value == "ok" else ATTENTION


def outputs_at(
    given: Mapping[str, Any],
    contents: Mapping[str, Callable[[Any], bytes]],
    draw: Callable[[Any], Any] | None = None,
) -> tuple[Output, ...]:
    """The document of an answer, and its ``contents`` by the names of the options that say where; what is drawn of it.

    Raises:
        MbmError: plot-format.

    """
    every = dict(contents) if given["json_path"] == STANDARD_OUTPUT else {"json_path": encoded, **contents}
    if draw is not None and given["plot_path"] is not None:
        every["plot_path"] = _picture(given["plot_path"], draw)
    asked = ((given[name], content) for name, content in every.items())
    return tuple(Output(path=path, content=content) for path, content in asked if path is not None)


def encoded(answer: BudgetAnswer | TrajectoryAnswer | Propagated | Design) -> bytes:
    """The document of an answer as JSON."""
    from mbm.report.encode import encode, to_bytes

    return to_bytes(encode(answer.document()))


def document_bytes(result: Result) -> bytes:
    """The result document as JSON."""
    from mbm.report.document import lazy_document
    from mbm.report.encode import encode, to_bytes

    return to_bytes(encode(lazy_document(result)))


def _solves(result: Result) -> bytes:
    from mbm.report.exports import write_solves

    return _as_bytes(lambda stream: write_solves(result, stream))


def _estimates(result: Result) -> bytes:
    from mbm.report.exports import write_estimates

    return _as_bytes(lambda stream: write_estimates(result, stream))


def _residuals(result: Result) -> bytes:
    from mbm.report.exports import write_residuals

    return _as_bytes(lambda stream: write_residuals(result, stream))


def _as_bytes(write: Callable[[TextIO], None]) -> bytes:
    stream = StringIO(newline="")
    write(stream)
    return stream.getvalue().encode("utf-8", errors="backslashreplace")


def _picture(path: str, draw: Callable[[Any], Any] | None = None) -> Callable[[Any], bytes]:
    """What draws a result, or an answer with ``draw``, in the format that the name of a file says."""
    from mbm.report import plots

    refuse_standard_output(path)
    ending = plots.format_of(path)
    return lambda found: plots.figure_bytes((draw or plots.draw)(found), ending)


def _overlay(path: str) -> Callable[[Result], bytes]:
    """What draws the images of a result in the format that the name of a file says."""
    from mbm.report.plots import format_of
    from mbm.report.view.wishes import overlay_bytes

    refuse_standard_output(path)
    ending = format_of(path)
    return lambda result: overlay_bytes(result, ending)
