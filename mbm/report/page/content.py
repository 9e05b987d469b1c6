"""Result → page: what was asked, what was measured, what came out, and what speaks against it."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from hashlib import sha256
from itertools import chain, islice
from math import isfinite

import numpy as np
import scipy

from mbm.problem.naming import key_text, key_words
from mbm.report.blocks import ManyReports
from mbm.report.budgets.budget import budgets_of
from mbm.report.budgets.text import HEADER, cells, chosen, heading, summary
from mbm.report.correlations import Correlation, correlation_of
from mbm.report.digits import plain
from mbm.report.elements import number_text, solve_scalars, unit_text
from mbm.report.encode import plain as plain_value
from mbm.report.intervals import lines_of
from mbm.report.many import MOST_SOLVES, statuses_in_words
from mbm.report.noise import noise_sentences
from mbm.report.page.pictures import residual_pictures, result_pictures
from mbm.report.page.types import Block, Bullets, Grid, Listing, Page, Paragraph, Pictures, Section
from mbm.report.sentences import (
    constraint_sentences,
    diagnostic_sentence,
    fit_sentence,
    observability_sentences,
    prior_sentences,
    residual_sentences,
    search_sentences,
)
from mbm.report.types import Result, SolveReport
from mbm.text.types import Diagnostic, MbmError

MOST_SCALARS = 80
"""Numbers of one solve that are listed."""
WORST = 3
"""Solves of many that are told in full: those that are trusted least."""
MOST_CHARACTERS = 20_000
"""Characters of a listing."""
MOST_DOUBTS = 40

LEGEND = (
    "Each number is the value ± one standard deviation (the standard uncertainty). The interval holds the true value "
    "with the probability that is stated, if the model and the noise are right: value ± k times the standard "
    "deviation, with k from Student's t distribution for the degrees of freedom (dof; ∞ where the noise was stated "
    "beforehand). Where it was found otherwise the last column says so: `profile` follows the curvature of the model, "
    "`limited` takes a hard limit of the value into account."
)
RESIDUALS = (
    "A residual is the model minus the measurement. Divided by its standard deviation it should look like a draw "
    "from the normal distribution with standard deviation 1: no trend over any column, 95 % between −2 and 2, points "
    "along the line of the quantiles. A row of large leverage decides much of what is fitted to it, so that its "
    "residual says little of its error."
)
BUDGET = (
    "Which input makes how much of the uncertainty: u is the standard uncertainty of the input, c the derivative of "
    "the result by it, |c|u its contribution. The squares of the contributions add up to the variance of the result."
)


def page_of(result: Result, command: str | None) -> Page:
    """The page of a result; ``command`` is what it was made by (None: Python)."""
    solves = result.solves
    many = len(solves) != 1
    sections = [Section("The problem", tuple(_problem(result))), Section("Data", tuple(_data(result)))]
    if many:
        sections.append(Section("Solves", tuple(many_blocks(result))))
        title = "Among the least trusted: {}"
        sections += [Section(title.format(key_words(s.key)), tuple(_answer(s))) for s in _worst(solves)]
    else:
        sections += _one(solves[0])
    sections.append(Section("Pictures", tuple(result_pictures(result))))
    sections.append(Section("Provenance", tuple(_provenance(result, command))))
    return Page(
        title=f"Report on {result.problem}",
        verdict=statuses_in_words(solves) if many else _verdict(solves[0]),
        trusted=result.status.value == "ok",
        sections=tuple(section for section in sections if section.blocks),
    )


def _verdict(solve: SolveReport) -> str:
    derived_only = solve.status.trusted and not solve.estimates
    said = "nothing is estimated, the results follow from the constants" if derived_only else solve.status.sentence
    return f"{solve.status.value}: {said}"


def _one(solve: SolveReport) -> Iterator[Section]:
    yield Section("Estimates", tuple(_answer(solve)))
    yield Section("Doubts", tuple(_doubts(solve)))
    yield Section("What the data cannot tell", tuple(_blind(solve)))
    yield Section("Uncertainty budget", tuple(budget_blocks(solve, BUDGET)))
    yield Section("Correlations", tuple(correlation_blocks(solve)))
    if solve.residual_summaries:
        yield Section("Residuals", (Paragraph(RESIDUALS), *_residuals(solve)))


def _problem(result: Result) -> Iterator[Block]:
    if result.described is not None:
        yield Paragraph("What is estimated, from which equations, and how, as mbm derived it from the problem file:")
        yield Listing(_cut(result.described()))
    if result.source is not None:
        yield Paragraph("The problem file:")
        yield Listing(_cut(result.source))


def _cut(text: str) -> str:
    if len(text) <= MOST_CHARACTERS:
        return text
    return f"{text[:MOST_CHARACTERS]}\n… {len(text) - MOST_CHARACTERS:,} more characters"


def _data(result: Result) -> Iterator[Block]:
    if result.inputs:
        rows = tuple((each.path, f"{each.rows:,}") for each in result.inputs[:MOST_SOLVES])
        yield Grid(titles=("file", "rows"), rows=rows)
    else:
        yield Paragraph("The data stand in the problem, or were handed over by a program; no file was read.")
    if len(result.solves) == 1:
        yield Bullets(tuple(residual_sentences(result.solves[0])))


def _answer(solve: SolveReport) -> Iterator[Block]:
    if not solve.status.trusted:
        yield Paragraph(solve.message or solve.status.sentence, doubt=True)
    grid = estimates_grid(solve)
    if grid.rows:
        yield Paragraph(LEGEND)
        yield grid
    noise = noise_sentences(solve.noise, solve.noise_units)
    said = [*filter(None, [fit_sentence(solve)]), *noise, *search_sentences(solve)]
    if said:
        yield Bullets(tuple(said))


def estimates_grid(solve: SolveReport) -> Grid:
    """Value, standard deviation and interval of each number."""
    intervals = {line.name: line for line in lines_of(solve)}
    rows = []
    for scalar in islice(solve_scalars(solve), MOST_SCALARS):
        line = intervals.get(scalar.name)
        notes = ["fixed"] * scalar.fixed + ["at its bound"] * scalar.at_bound + ["derived"] * scalar.derived
        notes += [line.kind] if line is not None and line.kind != "t" else []
        notes += [scalar.quantity.doc] if scalar.quantity.doc else []
        notes += [scalar.reason] if scalar.reason and not isfinite(scalar.sigma) and scalar.bounds is None else []
        rows.append(
            (
                scalar.name,
                str(number_text(scalar)),
                unit_text(scalar.quantity),
                "" if line is None else f"{line.low} … {line.high}",
                "" if line is None else line.k,
                "" if line is None else line.dof,
                ", ".join(notes),
            )
        )
    total = sum(1 for _ in solve_scalars(solve))
    more = f"{total - MOST_SCALARS:,} more numbers are in the result document." if total > MOST_SCALARS else ""
    titles = ("name", "value", "unit", f"{plain(100 * solve.coverage, 6)} % interval", "k", "dof", "remarks")
    return Grid(titles=titles, rows=tuple(rows), texts=frozenset({0, 2, 6}), caption=more)


def _doubts(solve: SolveReport) -> Iterator[Block]:
    said = [*constraint_sentences(solve), *prior_sentences(solve), *_told(solve.diagnostics)]
    if not said:
        yield Paragraph("Nothing that mbm looks at speaks against the numbers.")
    yield from doubts_told(said, MOST_DOUBTS)


def doubts_told(said: Sequence[str], most: int) -> Iterator[Paragraph]:
    """A paragraph for each doubt, the first so many of them."""
    yield from (Paragraph(text, doubt=True) for text in said[:most])
    if len(said) > most:
        yield Paragraph(f"… and {len(said) - most:,} more, which the result document lists.", doubt=True)


def _told(diagnostics: Iterable[Diagnostic]) -> Iterator[str]:
    """Each diagnostic once; what its kind means, and what to do, at its first."""
    told: set[str] = set()
    for diagnostic in dict.fromkeys(diagnostics):
        sentence = diagnostic_sentence(diagnostic)
        if diagnostic.code.name not in told:
            told.add(diagnostic.code.name)
            sentence = f"{sentence}. {diagnostic.code.meaning} What to do: {diagnostic.hint or diagnostic.code.mend}"
        yield sentence


def _blind(solve: SolveReport) -> Iterator[Block]:
    found = solve.observability
    if found is None or not found.dimension:
        return
    said = tuple(observability_sentences(found))
    if said:
        yield Bullets(said)
    if found.rank == found.dimension:
        yield Paragraph(f"The data determine all {found.dimension} numbers that were estimated.")
    else:
        yield Paragraph(f"The data determine {found.rank} of the {found.dimension} numbers that were estimated.")
    if isfinite(found.condition):
        yield Paragraph(
            f"The scaled Jacobian has the condition number {plain(found.condition, 3)}: so many times better is the "
            "combination of them that is known best than the one that is known worst."
        )


def _residuals(solve: SolveReport) -> Iterator[Block]:
    outliers = [text for text in residual_sentences(solve) if "outliers:" in text]
    if outliers:
        yield Paragraph("Rows taken for outliers:", doubt=True)
        yield Bullets(tuple(outliers))
    yield Pictures(tuple(residual_pictures(solve)))


def many_blocks(result: Result) -> Iterator[Block]:
    """A line for each of many solves, and what is said of them."""
    solves = result.solves
    names = list(dict.fromkeys(name for solve in solves[:MOST_SOLVES] for name in solve.key))
    rows = []
    for solve in islice(solves, MOST_SOLVES):
        keys = tuple("" if solve.key.get(name) is None else key_text(solve.key[name]) for name in names)
        numbers = ("" if solve.cost is None else plain(solve.cost, 5), "" if solve.dof is None else str(solve.dof))
        scalars = (s for s in solve_scalars(solve) if not s.fixed)
        text = "; ".join(f"{s.name} = {number_text(s)} {unit_text(s.quantity)}".rstrip() for s in islice(scalars, 4))
        rows.append((*keys, solve.status.value, *numbers, text))
    more = f"{len(solves) - MOST_SOLVES:,} more solves are in the result document." if len(solves) > MOST_SOLVES else ""
    count = len(names)
    texts = frozenset({*range(count + 1), count + 3})
    titles = (*names, "status", "cost", "dof", "estimates")
    yield Grid(titles=titles, rows=tuple(rows), texts=texts, caption=more)
    noted = list(islice(solves.noted() if isinstance(solves, ManyReports) else solves, 10 * MOST_SOLVES))
    said = list(_told(chain.from_iterable(solve.diagnostics for solve in noted)))
    yield from (Paragraph(text, doubt=True) for text in said[:MOST_DOUBTS])


def _worst(solves: Sequence[SolveReport]) -> list[SolveReport]:
    """The solves that are trusted least: by status, by what is said of them, by the misfit."""

    def trust(solve: SolveReport) -> tuple[bool, int, float]:
        tail = solve.chi2_p
        return solve.status.trusted, -len(solve.diagnostics), 1.0 if tail is None else min(tail, 1.0 - tail)

    noted = list(islice(solves.noted(), 10 * MOST_SOLVES)) if isinstance(solves, ManyReports) else list(solves)
    return sorted(noted, key=trust)[:WORST]


def _provenance(result: Result, command: str | None) -> Iterator[Block]:
    versions = (
        f"mbm {result.version}, Python {sys.version.split()[0]}, NumPy {np.__version__}, SciPy {scipy.__version__}"
    )
    rows = [("made by", command or "Python"), ("versions", versions), ("problem", result.problem)]
    if result.file is not None:
        rows.append(("file", result.file))
    if result.source is not None:
        rows.append(("SHA-256 of the problem", sha256(result.source.encode("utf-8", "surrogatepass")).hexdigest()))
    rows.append(("seed", "none: nothing random was done" if result.seed is None else str(result.seed)))
    rows += [(name, str(plain_value(value))[:200]) for name, value in result.options.items()]
    if len(result.solves) == 1:
        solve = result.solves[0]
        rows.append(("solved by", f"{solve.method}, {solve.iterations} iterations, {solve.evaluations} evaluations"))
    yield Grid(titles=("what", "value"), rows=tuple(rows), texts=frozenset({0, 1}))
    read = [(each.path, each.sha256) for each in result.inputs if each.sha256 is not None]
    if read:
        digests = tuple(read[:MOST_SOLVES])
        yield Grid(titles=("file", "SHA-256"), rows=digests, texts=frozenset({0, 1}))


MOST_BUDGETS = 8
MOST_INPUTS = 20
LARGEST_MATRIX = 10
"""Numbers whose correlations are shown as a matrix; of more, the strongest pairs."""
STRONGEST = 20
LARGEST_SEARCHED = 400
"""Numbers among which the strongest correlations are looked for."""


def budget_blocks(solve: SolveReport, explained: str) -> Iterator[Block]:
    """The budgets of the derived quantities first, as they are what was asked for; or why there are none."""
    try:
        budgets = budgets_of(solve)
    except MbmError as error:
        yield Paragraph("There is no budget: " + "; ".join(each.message for each in error.diagnostics))
        return
    derived = {item.quantity.name for item in solve.derived}
    ordered = sorted(budgets, key=lambda each: each.quantity.partition("[")[0] not in derived)
    if ordered:
        yield Paragraph(explained)
    for budget in ordered[:MOST_BUDGETS]:
        yield Paragraph(f"{heading(budget)}. {summary(budget)}.")
        rows = chosen(budget.rows, MOST_INPUTS)
        left = len(budget.rows) - len(rows)
        yield Grid(
            titles=HEADER,
            rows=tuple(map(cells, rows)),
            texts=frozenset({0, 1, 5}),
            caption=f"{left:,} more inputs contribute less." if left else "",
        )
    if len(ordered) > MOST_BUDGETS:
        yield Paragraph(f"`mbm budget` has {len(ordered) - MOST_BUDGETS:,} more.")


def correlation_blocks(solve: SolveReport) -> Iterator[Block]:
    """The matrix, or the pairs that are correlated most."""
    found = correlation_of(solve)
    if found is None or len(found.names) < 2:
        return
    if found.matrix is None or len(found.names) > LARGEST_SEARCHED:
        yield Paragraph(f"The correlations of {len(found.names):,} numbers are left out for their size.")
    elif len(found.names) <= LARGEST_MATRIX:
        rows = tuple((name, *map(_number, line)) for name, line in zip(found.names, found.matrix.tolist(), strict=True))
        yield Grid(titles=("", *found.names), rows=rows)
    else:
        yield _pairs(found, found.matrix)


def _pairs(found: Correlation, matrix: np.ndarray) -> Grid:
    first, second = np.triu_indices(len(found.names), 1)
    sizes = np.nan_to_num(np.abs(matrix[first, second]), nan=-1.0)
    order = np.argsort(-sizes, kind="stable")[:STRONGEST]
    rows = tuple(
        (found.names[first[i]], found.names[second[i]], _number(float(matrix[first[i], second[i]])))
        for i in order.tolist()
        if sizes[i] >= 0.0
    )
    caption = f"The strongest of {len(sizes):,} correlations."
    return Grid(titles=("of", "with", "correlation"), rows=rows, texts=frozenset({0, 1}), caption=caption)


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}"
