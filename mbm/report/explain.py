"""``mbm explain``: the derived observation model as text, or what one stage of the compiler made.

The steps of a sequence in words.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from mbm.emit.words import MOST_CASES
from mbm.equations.binding import EvaluationCache
from mbm.estimation.solve.choice import chosen_solver
from mbm.estimation.starts.closed_forms.types import ClosedForm
from mbm.expression.nodes import Number
from mbm.kernels.types import KernelSet, WithoutMachineCode
from mbm.problem.bounded import called, likelihood_of, refuse_mixed_bounds
from mbm.problem.checks import used_rows
from mbm.problem.elaborated import Elaborated
from mbm.problem.kinds import ConsensusKind, ConstraintKind
from mbm.problem.naming import PRIOR
from mbm.problem.overrides import ConstantValue
from mbm.problem.requests import Contractor, Enclosing
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import Table
from mbm.problem.types import (
    Block,
    BlockRole,
    Consensus,
    Equation,
    Loss,
    Method,
    NoiseKind,
    Problem,
    UncertainColumn,
    Unknown,
    UnknownKind,
)
from mbm.report.columns import wrapped
from mbm.symbolic.printing import latex_name, printed
from mbm.symbolic.types import ColumnInput, Parameter, Purpose, ResidualBlock, Slot, SymbolicModel
from mbm.text.shown import joined
from mbm.text.types import MbmError


def steps_text(problem: Problem, sequence: Sequence, tables: Mapping[str, Table]) -> str:
    """How many steps there are, from where to where, of which tables; and how many have no row that is observed."""
    steps = tables[sequence.steps].numbers(sequence.column)
    named = ", ".join(dict.fromkeys(table for table, _ in sequence.sources))
    ends = f" from {steps[0]:g} to {steps[-1]:g}" if len(steps) else ""
    told = f"{len(steps)} step{'' if len(steps) == 1 else 's'}{ends}: the values of {sequence.column} in {named}"
    predicted = len(steps) - len(_seen(problem, sequence, tables))
    return told + (f"; {predicted} without a row that is observed" if predicted else "")


def _seen(problem: Problem, sequence: Sequence, tables: Mapping[str, Table]) -> set[float]:
    """The steps that have rows of observations."""
    found: set[float] = set()
    for block in problem.blocks:
        if block.role is not BlockRole.OBSERVATION or block.table is None:
            continue
        table = tables[block.table]
        if sequence.column in table.columns:
            used = used_rows(block, tables)
            numbers = table.numbers(sequence.column)
            found.update(np.unique(numbers if used is None else numbers[used]).tolist())
    return found


WIDEST_PROPERTY = 100
"""Columns of what a problem says of itself."""

_SOLVERS = {
    "linear": "one step of linear least squares",
    "lm": "lm (Marquardt)",
    "penalty": "multiplied penalties, finished by sequential quadratic programming",
    "exact": "sequential quadratic programming with an active set",
}
_NOT_BELOW = {False: "≥", True: r"\ge"}


_CONTRACTORS = {
    Contractor.FORWARD: "forward evaluation of the box from `:in` and the constraints, without the observations",
    Contractor.HC4: "forward and backward contraction to the fixed point of hull consistency (HC4)",
    Contractor.HULL: "HC4 contraction, bisected until the bounds are attained",
}
_METHODS = {
    ConsensusKind.LMEDS: "least median of squares",
    ConsensusKind.RANSAC: "RANSAC: as many measurements as possible",
    ConsensusKind.MSAC: "MSAC: as many measurements as possible, and those close",
    ConsensusKind.GNC: "graduated non-convexity",
}


def explanation(
    found: Elaborated,
    model: SymbolicModel,
    kernels: KernelSet,
    cache: EvaluationCache,
    closed_forms: tuple[ClosedForm, ...],
    *,
    latex: bool,
) -> str:
    """Equations, unknowns, noise, structure of the Jacobian, and the solver with the reason for it."""
    problem, tables = found.problem, found.tables
    doc = wrapped(problem.doc, WIDEST_PROPERTY - 2) if problem.doc else []
    lines = [f"problem {problem.name}", *(f"  {line}" for line in doc), ""]
    if problem.unknowns:
        lines += ["unknowns", *(f"  {line}" for u in problem.unknowns for line in _unknown(u, tables)), ""]
    if problem.sequence is not None:
        lines += ["sequence", *(f"  {line}" for line in _sequence(problem, problem.sequence, tables)), ""]
    if problem.constants:
        lines += ["constants", *(f"  {_constant(each)}" for each in problem.constants), ""]
    for i, block in enumerate(problem.blocks):
        lines += [*_block(i, block, tables, model, latex=latex), ""]
    for i, derived in enumerate(problem.derived):
        blocks = [b for b in model.blocks if b.purpose is Purpose.DERIVED and b.owner == i]
        over = f" for each row of {derived.table}" if derived.table else ""
        lines += [f"derived {derived.name}{over}", *_equations(blocks[:1], derived.name, latex=latex), ""]
    for i, aggregate in enumerate(problem.aggregates):
        blocks = [b for b in model.blocks if b.purpose is Purpose.AGGREGATE and b.owner == i]
        title = f"{aggregate.name}: {aggregate.kind.value} over the rows of {aggregate.table} of"
        lines += [title, *_equations(blocks[:1], "value", latex=latex), ""]
    lines += ["solver", *(f"  {line}" for line in _solver(found, kernels, cache, closed_forms))]
    return joined(lines) + "\n"


def _constant(constant: ConstantValue) -> str:
    """In SI, with the standard deviations of an uncertain one."""
    values = " ".join(f"{value:.12g}" for value in constant.values)
    spread = " ".join(f"{sigma:.3g}" for sigma in constant.sigmas)
    return f"{constant.name} = {values}" + (f" ± {spread}" if spread else "")


def _unknown(unknown: Unknown, tables: Mapping[str, Table]) -> Iterator[str]:
    kind = unknown.kind.value
    if unknown.dimension:
        kind = kind if unknown.kind is UnknownKind.DIRECTION else f"({kind} {unknown.dimension})"
    elif unknown.shape:
        kind = f"({kind} {' '.join(map(str, unknown.shape))})"
    text = f"{unknown.name}  {kind}"
    if unknown.is_state and unknown.family is not None:
        text += f" at each of {len(tables[unknown.family.rows])} {unknown.family.rows}"
    elif unknown.family is not None:
        text += f" per {unknown.family.rows} ({len(tables[unknown.family.rows])} members)"
    options = [
        name
        for name, given in (
            ("start given", unknown.start),
            ("bounded", unknown.lower),
            ("start range", unknown.start_lower),
            ("fixed in part", unknown.fixed),
        )
        if given is not None
    ]
    if unknown.unit is not None:
        options.append(f"reported in {unknown.unit.symbol}")
    yield text + (f"; {', '.join(options)}" if options else "")


def _sequence(problem: Problem, sequence: Sequence, tables: Mapping[str, Table]) -> Iterator[str]:
    """The steps, how the states get from one to the next, and how they are estimated."""
    yield steps_text(problem, sequence, tables)
    for transition in sequence.transitions:
        yield f"{' and '.join(transition.states)}: {' '.join(transition.span.text.split())}"
    yield f"estimated by {sequence.estimator.method.value}"


def _block(
    number: int, block: Block, tables: Mapping[str, Table], model: SymbolicModel, *, latex: bool
) -> Iterator[str]:
    word = "observe" if block.role is BlockRole.OBSERVATION else block.role.value
    name = block.name.removeprefix(PRIOR)
    over = f" for each of {len(tables[block.table])} rows of {block.table}" if block.table else ""
    yield f"{word} {name}{over}"
    if block.role is not BlockRole.CONSTRAINT:
        yield f"  noise: {_noise(block)}"
        if block.loss is not None:
            yield f"  loss: {loss_text(block.loss)}"
        if block.errors:
            yield f"  errors in measured columns, corrected: {', '.join(map(_uncertain, block.errors))}"
    sign = "=" if block.constraint in (None, ConstraintKind.EQUAL) else _NOT_BELOW[latex]
    found = [b for b in model.blocks if b.purpose is Purpose.EQUATION and b.owner == number]
    for each in found[:MOST_CASES]:
        static = block.cases[each.case].static
        if static:
            yield "  where " + ", ".join(f"{column} = {_shown(value)}" for column, value in static)
        yield from _equations([each], "0", latex=latex, sign=sign)
        yield from _structure(each)
    if len(found) > MOST_CASES:
        yield f"  … and {len(found) - MOST_CASES} more groups of rows with other static values"


def _uncertain(column: UncertainColumn) -> str:
    """A corrected column, by the name that the equations have for it, and where it was measured if that is another."""
    own = "" if column.key is None else f" (one for each row of {column.table})"
    return column.name + own


def _noise(block: Block) -> str:
    likelihood = likelihood_of(block)
    if likelihood is not None:
        text = called(likelihood).replace("`", "")
        return f"{text}, up to one unknown factor" if block.unknown_factor else text
    noise = [n for case in block.cases for e in case.equations for n in e.noise]
    if block.errors and all(isinstance(n, Number) and n.value == 0 for n in noise):
        return "none of their own"
    if block.structure.free:
        return "unknown covariance of the components of a row, estimated from the residuals"
    return f"{_of_rows(block)}{_shared(block)}"


def _shared(block: Block) -> str:
    """What rows share of their noise."""
    structure = block.structure
    found = [f"a common error for each `{column}`" for column in structure.per]
    if structure.correlation is not None:
        known = "unknown" if structure.unknown else "stated"
        found.append(f"a correlation along the rows, {known}")
    return f"; with {' and '.join(found)}" if found else ""


def _of_rows(block: Block) -> str:
    """The noise that each row has for itself."""
    kinds = {e.noise_kind for case in block.cases for e in case.equations}
    if block.unknown_factor and all(_is_unstated(e) for case in block.cases for e in case.equations):
        return "unknown, estimated from the residuals"
    words = {
        NoiseKind.SIGMA: "stated standard deviations",
        NoiseKind.COVARIANCE: "stated covariance matrix",
        NoiseKind.INFORMATION: "stated information matrix",
        NoiseKind.BOUND: "stated bounds",
    }
    text = " and ".join(words[k] for k in sorted(kinds)) or "none"
    if block.structure.shared is not None:
        return f"{text}, up to the unknown factor `{block.structure.shared}`"
    return f"{text}, up to one unknown factor" if block.unknown_factor else text


def _is_unstated(equation: Equation) -> bool:
    """Whether the noise is the 1 that stands where the file says nothing, or ``unknown``."""
    return all(isinstance(n, Number) and n.value == 1 and n.span is None for n in equation.noise)


def _shown(value: str | float) -> str:
    return f"`{value}`" if isinstance(value, str) else f"{value:g}"


def _equations(blocks: Iterable[ResidualBlock], left: str, *, latex: bool, sign: str = "=") -> Iterator[str]:
    for block in blocks:
        equations = printed(block, latex=latex)
        yield from (f"    {line}" for line in equations.definitions)
        name = latex_name(left) if latex else left
        yield from (f"    {name} {sign} {line}" for line in equations.components)


def _structure(block: ResidualBlock) -> Iterator[str]:
    rows = len(block.expressions)
    names = ", ".join(symbol.name for symbol in block.variable_symbols) or "nothing"
    yield f"    Jacobian block: {rows} × {len(block.tangents)}, with respect to {names}"
    if block.corrected:
        measured = ", ".join(block.parameter_symbols[i].name for i in block.corrected)
        yield f"    and H_y: {rows} × {len(block.corrected)}, with respect to {measured}"


def _solver(
    found: Elaborated, kernels: KernelSet, cache: EvaluationCache, closed_forms: tuple[ClosedForm, ...]
) -> Iterator[str]:
    try:
        refuse_mixed_bounds(found.problem)
    except MbmError as error:
        yield from _refused(error)
        return
    if found.problem.request.method is Method.INTERVAL:
        yield from enclosing_texts(found.problem.request.enclosing or Enclosing())
        yield from _keys(found)
        return
    try:
        choice = chosen_solver(found, kernels, cache, closed_forms)
    except MbmError as error:
        yield from _refused(error)
        return
    if choice is None:
        yield "none: the data ask for no solve"
    else:
        yield f"{_SOLVERS.get(choice.solver, choice.solver)}: {choice.reason}"
        yield f"start: {choice.start}"
    if isinstance(cache.backend, WithoutMachineCode):
        yield f"equations: evaluated by NumPy and CasADi, as no machine code can be made here: {cache.backend.reason}"
    if found.problem.request.robust is not None:
        yield f"outliers: {consensus_text(found.problem.request.robust)}"
    yield from _keys(found)


def _refused(error: MbmError) -> Iterator[str]:
    for each in error.diagnostics:
        yield f"none: {each.message}" + (f". {each.hint[:1].upper()}{each.hint[1:]}" if each.hint else "")


def _keys(found: Elaborated) -> Iterator[str]:
    keys, window = found.problem.request.for_each, found.problem.request.window
    if keys:
        yield f"one solve for each value of {', '.join(keys)}"
    if window is not None:
        least = f", with at least {window.min_rows} rows" if window.min_rows > 1 else ""
        carried = ", beginning with what rows that have left say" if window.carry else ""
        yield (
            f"{'and' if keys else 'one solve'} for each window of {window.length:g} of {window.column}, "
            f"one every {window.step:g} (SI units){least}{carried}"
        )


def enclosing_texts(asked: Enclosing) -> Iterator[str]:
    """How bounds are found."""
    yield f"interval: {_CONTRACTORS[asked.contractor]}"
    if asked.contractor is Contractor.FORWARD or (asked.fraction >= 1.0 and not asked.widths):
        yield "no bisection"
        return
    own = "".join(f", `{name}` to {max(float(w.value) for w in widths):g}" for name, widths in asked.widths.items())
    yield f"bisection: to {100 * asked.fraction:g} % of each side{own}; at most {asked.boxes:,} boxes"


def problem_stage(problem: Problem, tables: Mapping[str, Table]) -> str:
    """The typed problem: tables, unknowns, blocks with their static cases."""
    lines = [f"problem {problem.name}"]
    lines += [f"table {table.name}: {len(table)} rows; {', '.join(table.columns)}" for table in tables.values()]
    lines += [line for u in problem.unknowns for line in _unknown(u, tables)]
    for block in problem.blocks:
        sizes = {sum(len(e.components) for e in case.equations) for case in block.cases}
        shown = "/".join(map(str, sorted(sizes))) or "0"
        over = f" over {block.table}" if block.table else ""
        lines.append(f"{block.role.value} {block.name}{over}: {len(block.cases)} cases of {shown} components")
    lines += [f"derived {d.name}: shape {d.shape or 'number'}" for d in problem.derived]
    return joined(lines) + "\n"


def symbolic_stage(model: SymbolicModel, *, latex: bool) -> str:
    """Every block with its inputs and equations."""
    lines = []
    for block in model.blocks:
        lines.append(f"{block.purpose.value} {block.name}, case {block.case + 1}")
        lines.append(f"  variables: {', '.join(s.name for s in block.variable_symbols) or 'none'}")
        lines.append(f"  parameters: {', '.join(s.name for s in block.parameter_symbols) or 'none'}")
        lines.extend(_equations([block], "h", latex=latex))
    return joined(lines) + "\n"


def kernel_stage(kernels: KernelSet) -> str:
    """Every kernel with its inputs, outputs, nonzeros and instructions."""
    lines = [f"kernels of {kernels.name}, fingerprint {kernels.fingerprint()[:16]}"]
    for kernel in kernels.kernels:
        lines.append(
            f"{kernel.purpose.value} {kernel.name}, case {kernel.case + 1}: {kernel.outputs} outputs, "
            f"{len(kernel.jacobian_rows)} nonzeros of {kernel.outputs} × {len(kernel.tangents)}, "
            f"{len(kernel.jacobian_program.instructions)} instructions"
        )
        lines.append(f"  variables: {', '.join(_slot(s) for s in kernel.variables) or 'none'}")
        lines.append(f"  parameters: {', '.join(_parameter(p) for p in kernel.parameters) or 'none'}")
    return joined(lines) + "\n"


def _slot(slot: Slot) -> str:
    member = ""
    if slot.member is not None:
        member = f"[{getattr(slot.member, 'key', None) or getattr(slot.member, 'column', '')}]"
    return f"{slot.unknown}{member}.{slot.component + 1}"


def _parameter(parameter: Parameter) -> str:
    if isinstance(parameter, ColumnInput):
        return f"{parameter.table}.{parameter.name}"
    return parameter.name


def loss_text(loss: Loss) -> str:
    """The loss with its parameters."""
    shape = "" if loss.shape is None else f" with exponent {loss.shape:g}"
    scale = "its parameter for 95 % efficiency" if loss.scale is None else f"beyond {loss.scale:g} standard deviations"
    return f"{loss.kind.value}{shape}, {scale}"


def consensus_text(consensus: Consensus) -> str:
    """How the measurements that agree are found."""
    trials = "" if consensus.trials is None else f", {consensus.trials} trials"
    limit = "" if consensus.threshold is None else f", within {consensus.threshold:g} standard deviations"
    if consensus.quantile is not None:
        limit = f", within the {100 * consensus.quantile:g} % quantile of chi²"
    if consensus.trusting:
        limit += ", trusted rows never rejected"
    return f"{_METHODS[consensus.kind]}{trials}{limit}; then a fit to the measurements that agree"
