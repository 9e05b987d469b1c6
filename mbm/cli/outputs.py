"""The files that a command writes: looked at before the work is done, written after it, each as far as it can be."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mbm.cli.documents import STANDARD_OUTPUT, refuse_standard_output
from mbm.cli.failure import print_diagnostics
from mbm.cli.options import Terminal, problem_at, reads_so_far, terminal
from mbm.cli.output import write_bytes
from mbm.cli.statuses import ATTENTION, OK, WRONG
from mbm.files.journal import Read, option_role
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.files.targets import Target
    from mbm.report.types import Result

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A file: where it goes, what it holds of an answer, the roles for which it may have been read and be replaced."""

    path: str
    content: Callable[[Any], bytes]
    allowed: tuple[str, ...] = ()

    def check(self, reads: Iterable[Read]) -> Target:
        """What speaks against writing, as far as can be said before. Raises MbmError."""
        from mbm.files.writing import checked_target

        refuse_standard_output(self.path)
        return checked_target(self.path, reads=reads, allowed=self.allowed)

    def write(self, answer: Any, reads: Iterable[Read]) -> None:
        """Write the file. Raises MbmError."""
        from mbm.files.writing import write_whole

        write_whole(self.path, self.content(answer), reads=reads, allowed=self.allowed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenes:
    """A folder for another program: the format of its files, and whether it may hold others."""

    form: str
    folder: Path
    force: bool

    def check(self, reads: Iterable[Read]) -> None:
        """As of a file."""
        from mbm.files.folders import check_folder
        from mbm.files.names import WRITE
        from mbm.report.scenes.formats import check_format

        check_format(self.form)
        refuse_standard_output(self.folder)
        check_folder(self.folder, WRITE, force=self.force, reads=reads)

    def write(self, answer: Any, reads: Iterable[Read]) -> None:
        """Write the files. Raises MbmError."""
        from mbm.report.scenes.formats import write

        write(answer, self.form, self.folder, force=self.force, reads=tuple(reads))


def outputs_at(
    given: Mapping[str, Any],
    contents: Mapping[str, Callable[[Any], bytes]],
    draw: Callable[[Any], Any] | None = None,
    document: Callable[[Any], bytes] | None = None,
) -> tuple[Output, ...]:
    """The document of an answer, and its ``contents`` by the names of the options that say where; what is drawn of it.

    Raises:
        MbmError: plot-format.

    """
    at = None if given["json_path"] == STANDARD_OUTPUT else given["json_path"]
    # A document may take the place of the one that it began from.
    found = [] if at is None else [Output(path=at, content=document or encoded, allowed=(option_role("--init"),))]
    found += [Output(path=given[name], content=each) for name, each in contents.items() if given[name] is not None]
    if draw is not None and given["plot_path"] is not None:
        found.append(Output(path=given["plot_path"], content=drawn(given["plot_path"], draw)))
    return tuple(found)


def drawn(path: str, draw: Callable[[Any], Any]) -> Callable[[Any], bytes]:
    """What draws an answer in the format that the name of a file says."""
    from mbm.report.figures import figure_bytes, format_of

    refuse_standard_output(path)
    ending = format_of(path)
    return lambda found: figure_bytes(draw(found), ending)


def check_outputs(outputs: Iterable[Output | Scenes], reads: Iterable[Read]) -> None:
    """What speaks against writing, as far as can be said before there is anything to write.

    Raises:
        MbmError: not-writable, would-overwrite, unknown-output, foreign-folder: all that was found; two go to one.

    """
    outputs, reads, targets, wrong = tuple(outputs), tuple(reads), list["Target"](), list[Diagnostic]()
    for output in outputs:
        try:
            targets += filter(None, [output.check(reads)])
        except MbmError as error:
            wrong.extend(error.diagnostics)
    if wrong:
        raise MbmError(*wrong)
    if outputs:
        from mbm.files.folders import refuse_one_folder
        from mbm.files.targets import refuse_twice

        refuse_twice(targets)
        refuse_one_folder([each.folder for each in outputs if isinstance(each, Scenes)])


def answered(
    given: Mapping[str, Any],
    outputs: Sequence[Output | Scenes],
    find: Callable[[Callable[[], None]], T],
    show: Callable[[T, Terminal], None],
    *,
    doubts: Callable[[Any], Iterable[Diagnostic]] = lambda found: found.result.diagnostics,
    document: Callable[[Any], bytes] | None = None,
    fine: Callable[[Any], bool] = lambda found: found.status.value == "ok",
) -> int:
    """Find an answer, write ``outputs`` of it, and say its document, where ``--json -`` asks for that, or its text.

    ``find`` calls what it is given once everything was read, before the work begins; ``show`` says the text, and
    ``doubts`` are warnings. An answer that is not ``fine`` needs attention.

    Returns:
        The exit status.

    Raises:
        MbmError: nothing was found, or a file would be in the way.

    """
    screen = terminal()
    check_outputs(outputs, problem_at(given["file"]))
    found = find(lambda: check_outputs(outputs, reads_so_far()))
    print_diagnostics(() if screen.quiet else tuple(doubts(found)), color=screen.color_errors)
    wrong: list[Diagnostic] = []
    for output in outputs:
        try:
            output.write(found, reads_so_far())
        except MbmError as error:
            wrong.extend(error.diagnostics)
    try:
        if given["json_path"] == STANDARD_OUTPUT:
            write_bytes((document or encoded)(found))
        else:
            show(found, screen)
    except MbmError as error:  # the files are there, and stay
        wrong.extend(error.diagnostics)
    print_diagnostics(wrong, color=screen.color_errors)
    return WRONG if wrong else OK if fine(found) else ATTENTION


def encoded(answer: Any) -> bytes:
    """The document of an answer as JSON."""
    from mbm.report.encode import encode, to_bytes

    return to_bytes(encode(answer.document()))


def document_bytes(result: Result) -> bytes:
    """The result document as JSON."""
    from mbm.report.document import lazy_document
    from mbm.report.encode import encode, to_bytes

    return to_bytes(encode(lazy_document(result)))
