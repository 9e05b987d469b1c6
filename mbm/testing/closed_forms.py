"""Conformance of closed forms: `ClosedForm` of `mbm.estimation.starts.closed_forms.types`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

import numpy as np

from mbm.api import loads
from mbm.equations.types import Floats
from mbm.estimation.solve.estimate import assemble
from mbm.estimation.starts.closed_forms.completion import plans
from mbm.estimation.starts.closed_forms.types import ClosedForm, Plan, Situation
from mbm.testing.requirement import require, require_close
from mbm.values import dataclass

KEPT_DIGITS = 1e-6
"""Relative error of an answer for data without noise: half the digits, which closed forms that square numbers keep."""

FOREIGN = """
(problem foreign
  (data d (table (x y) (0 1) (1 2) (2 2) (3 1) (4 0.5) (5 0.2)))
  (unknowns (a) (b) (c))
  (observe d (= y (* a (exp (- (* b (^ (- x c) 2))))))))
"""
"""A problem that no closed form solves: it is in no unknown set linear, and knows neither points nor distances."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedFormSample:
    """A problem without starts whose data have no noise, and the numbers that its unknowns have then, by name.

    ``numbers`` holds them as mbm does: quaternion (w x y z) or angle, then translation, then scale; a family member by
    member.
    """

    text: str
    numbers: Mapping[str, Floats]
    data: Mapping[str, object] = field(default_factory=dict)


def check_closed_form(form: ClosedForm, sample: ClosedFormSample) -> None:
    """Whether a closed form keeps what starts and consensus rely on.

    Raises:
        NotConformingError: it does not; the text says what was promised.

    """
    subject = f"closed form `{form.name}`"
    require(bool(form.name) and form.name == form.name.strip(), "a closed form", "it has a name, as in `:method`")
    plan, truth = _recognised(form, sample)
    require(plan is not None, subject, "it recognises the sample")
    if plan is None:
        return
    again, _ = _recognised(form, sample)
    require(again is not None and len(again.rows) == len(plan.rows), subject, "it recognises the sample each time")
    foreign, _ = _recognised(form, ClosedFormSample(text=FOREIGN, numbers={}))
    require(foreign is None, subject, "it does not recognise equations of another kind")
    require(plan.minimal >= 1, subject, "`minimal` counts rows")
    if form.joint:
        _check_joint(form, plan, truth, subject)
        return
    for member in range(plan.candidate.members):
        _check_member(form, plan, member, truth, subject)


def _recognised(form: ClosedForm, sample: ClosedFormSample) -> tuple[Plan | None, Floats]:
    compiled = loads(sample.text).compile(data=sample.data)
    found = compiled.elaborated
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    layout = equations.layout
    truth = layout.start.copy()
    for name, numbers in sample.numbers.items():
        truth[layout.entry(name).range] = np.asarray(numbers, dtype=np.float64).ravel()
    situation = Situation(layout=layout, groups=equations.groups, numbers=layout.start)
    return next(iter(plans(situation, (form,))), None), truth


def _check_joint(form: ClosedForm, plan: Plan, truth: Floats, subject: str) -> None:
    size = plan.candidate.places.size
    found = form.solve(plan, np.arange(len(plan.rows))[None])
    require(found.ndim == 3 and found.shape[::2] == (1, size), subject, "`solve` answers (subsets, solutions, numbers)")
    _require_among(found[0], truth[plan.candidate.places.ravel()], subject)


def _check_member(form: ClosedForm, plan: Plan, member: int, truth: Floats, subject: str) -> None:
    rows = plan.rows.of_member(member)
    size = plan.candidate.places.shape[1]
    wanted = truth[plan.candidate.places[member]]
    found = form.solve(plan, rows[None])
    require(found.ndim == 3 and found.shape[::2] == (1, size), subject, "`solve` answers (subsets, solutions, numbers)")
    _require_among(found[0], wanted, subject)
    _require_among(form.solve(plan, rows[::-1][None])[0], wanted, f"{subject}, rows the other way round")
    if len(rows) < plan.minimal + 1:
        return
    subsets = np.stack([np.roll(rows, -i)[: plan.minimal] for i in range(3)])
    together = form.solve(plan, subsets)
    require(together.shape[::2] == (3, size), subject, "`solve` takes many subsets at once")
    for subset, answer in zip(subsets, together, strict=True):
        alone = form.solve(plan, subset[None])[0]
        same = np.allclose(alone, answer, rtol=1e-9, atol=1e-9, equal_nan=True)
        require(same, subject, "a subset is solved as it is alone")
        if bool(np.isfinite(answer).all(axis=1).any()):
            _require_among(answer, wanted, f"{subject}, `minimal` rows")


def _require_among(solutions: Floats, wanted: Floats, subject: str) -> None:
    """One of the solutions (S, s) is the wanted one."""
    usable = solutions[np.isfinite(solutions).all(axis=1)]
    require(bool(len(usable)), subject, "data without noise have a solution")
    errors = np.abs(usable - wanted).max(axis=1)
    nearest = usable[int(np.argmin(errors))]
    scale = max(float(np.abs(wanted).max()), 1.0)
    require_close(nearest / scale, wanted / scale, KEPT_DIGITS, subject, "data without noise give their truth back")
