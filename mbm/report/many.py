"""Many solves → one line each, and what is to be said of all of them together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

from mbm.problem.naming import key_text, key_words
from mbm.report.blocks import ManyReports
from mbm.report.columns import aligned, left, right, wrapped
from mbm.report.digits import Measured, plain
from mbm.report.elements import Scalar, number_text, solve_scalars, unit_text
from mbm.report.sentences import diagnostic_sentence, observability_sentences
from mbm.report.solve_columns import solve_columns
from mbm.report.types import SolveReport, SolveStatus, statuses_of
from mbm.text.shown import Paint, Style, cell_width
from mbm.text.types import Diagnostic
from mbm.values import dataclass

MOST_SOLVES = 60
"""Solves that are shown one by one; the table says how many more there are."""

_FIRST_SOLVES = 50
_MOST_EXPLAINED = 5


@dataclass(frozen=True, slots=True)
class _Column:
    """A title and, below it, cells: ``lines``, padded to one ``width``."""

    lines: tuple[str, ...]

    @property
    def width(self) -> int:
        return cell_width(self.lines[0])


def _column(title: str, cells: Iterable[str]) -> _Column:
    return _Column(tuple(left((title, *cells))))


def many_solves(solves: Sequence[SolveReport], width: int, paint: Paint, full: bool) -> Iterator[str]:
    """A compact table of the solves and, below it, their statuses, what needs attention, and the warnings."""
    if not solves:
        yield "no solves: the key columns hold no value"
        return
    shown = tuple(solves) if full or len(solves) <= MOST_SOLVES else solves[:_FIRST_SOLVES]
    columns, left_out = _fitting(shown, width, full)
    titles, *lines = ("  ".join(cells).rstrip() for cells in zip(*(column.lines for column in columns), strict=True))
    yield paint(titles, Style.HEADING)
    for line, solve in zip(lines, shown, strict=True):
        yield line if solve.status.trusted else paint(line, Style.WARNING)
    if len(shown) < len(solves):
        yield paint(f"… {len(solves) - len(shown)} more solves (-v shows all)", Style.QUIET)
    if left_out:
        yield paint(f"… {left_out} more columns (-v shows all; --csv and --json have them too)", Style.QUIET)
    for sentence in _without_sigma(shown):
        yield from (paint(line, Style.QUIET) for line in wrapped(sentence, width))
    yield ""
    yield from _totals(solves, width, paint)


def _without_sigma(solves: Sequence[SolveReport]) -> Iterator[str]:
    """Why quantities of solves that are to be trusted have no standard deviations: each reason once."""
    names: dict[str, dict[str, None]] = {}
    for scalar in chain.from_iterable(solve_scalars(solve) for solve in solves if solve.status.trusted):
        if scalar.reason and scalar.sigma != scalar.sigma and scalar.bounds is None:
            names.setdefault(scalar.reason, {})[f"`{scalar.quantity.name}`"] = None
    for reason, found in names.items():
        yield f"no standard deviation of {', '.join(found)}: {reason}"


def _fitting(solves: Sequence[SolveReport], width: int, full: bool) -> tuple[list[_Column], int]:
    """The columns that fit, keys first, and how many scalars found no room."""
    columns = _key_columns(solves)
    if any(solve.status is not SolveStatus.CONVERGED for solve in solves):
        columns.append(_column("status", (solve.status.value for solve in solves)))
    fit = [
        _column("cost", aligned(["" if s.cost is None else plain(s.cost, 5) for s in solves])),
        _column("dof", right("" if s.dof is None else str(s.dof) for s in solves)),
    ]
    wanted = _scalar_columns(solves)
    taken = sum(column.width + 2 for column in chain(columns, fit))
    count = 0
    for column in wanted:
        taken += column.width + 2
        if taken > width + 2 and not full and count > 0:
            break
        count += 1
    return [*columns, *wanted[:count], *fit], len(wanted) - count


def _key_columns(solves: Sequence[SolveReport]) -> list[_Column]:
    names = dict.fromkeys(name for solve in solves for name in solve.key)
    columns = []
    for name in names:
        keys = [solve.key.get(name) for solve in solves]
        texts = ["" if key is None else key if isinstance(key, str) else key_text(key) for key in keys]
        numeric = all(isinstance(key, float | int) for key in keys)
        columns.append(_column(name, aligned(texts) if numeric else texts))
    return columns


def _scalar_columns(solves: Sequence[SolveReport]) -> list[_Column]:
    """A column for each scalar that any solve has, in the order in which they first occur; fixed ones not."""
    found = [{scalar.name: scalar for scalar in solve_scalars(solve)} for solve in solves]
    units = {s.name: unit_text(s.quantity) for solve in found for s in solve.values() if not s.fixed}
    columns = []
    for name, unit in units.items():
        cells = [_cell(solve.get(name)) for solve in found]
        values, sigmas = aligned([cell.value for cell in cells]), aligned([cell.sigma for cell in cells])
        signs = ["±" if cell.sigma else " " for cell in cells]
        texts = [f"{value} {sign} {sigma}" for value, sign, sigma in zip(values, signs, sigmas, strict=True)]
        columns.append(_column(f"{name} ({unit})" if unit else name, (text.rstrip() for text in texts)))
    return columns


def _cell(scalar: Scalar | None) -> Measured:
    if scalar is None:
        return Measured("")
    return number_text(scalar)


def statuses_in_words(solves: Sequence[SolveReport]) -> str:
    """How many solves there are, and how many ended in which way."""
    counts = Counter(statuses_of(solves))
    parts = ", ".join(f"{counts[status]} {status.value}" for status in SolveStatus if counts[status])
    return f"{len(solves)} solve{'' if len(solves) == 1 else 's'}{': ' if parts else ''}{parts}"


def _totals(solves: Sequence[SolveReport], width: int, paint: Paint) -> Iterator[str]:
    found = solve_columns(solves)
    yield statuses_in_words(solves)
    pairs = zip(found.fits["cost"], found.fits["dof"], strict=True)
    fits = [(cost, dof) for cost, dof in pairs if cost is not None and dof is not None]
    if fits and found.stated:
        cost, dof = sum(cost for cost, _ in fits), sum(dof for _, dof in fits)
        yield f"together: cost {plain(cost, 6)} with {dof} degrees of freedom"
    noted = list(solves.noted()) if isinstance(solves, ManyReports) else solves
    for sentence in chain(_attention(noted), _warnings(noted)):
        yield from (paint(line, Style.WARNING) for line in wrapped(sentence, width))


def _attention(solves: Sequence[SolveReport]) -> Iterator[str]:
    """Which solves are not to be trusted, and why."""
    troubled = [solve for solve in solves if not solve.status.trusted]
    for solve in troubled[:_MOST_EXPLAINED]:
        reasons = list(observability_sentences(solve.observability)) or [solve.message or solve.status.sentence]
        yield f"{key_words(solve.key)}: {solve.status.value}: {'; '.join(reasons)}"
    if len(troubled) > _MOST_EXPLAINED:
        yield f"… {len(troubled) - _MOST_EXPLAINED} more solves need attention"


def _warnings(solves: Sequence[SolveReport]) -> Iterator[str]:
    """Each kind of warning once, with the key of its solve, and the number of further ones."""
    first: dict[str, tuple[str, Diagnostic]] = {}
    counts: Counter[str] = Counter()
    for solve in solves:
        for diagnostic in solve.diagnostics:
            first.setdefault(diagnostic.code.name, (key_words(solve.key), diagnostic))
            counts[diagnostic.code.name] += 1
    for code, (key, diagnostic) in first.items():
        more = "" if counts[code] == 1 else f", and {counts[code] - 1} more like it"
        yield f"{diagnostic_sentence(diagnostic)} ({key}{more})"
