"""The design of a problem file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.api.designs import design_of
from mbm.api.files import inputs_of
from mbm.api.problem import opened

if TYPE_CHECKING:
    from mbm.report.designs.answer import Design
    from mbm.report.designs.types import DesignWish
    from mbm.report.options import SolveOptions


def design_file(
    path: str | Path, options: SolveOptions, at: Mapping[str, object] | None, candidates: str | None, wish: DesignWish
) -> Design:
    """The design of a problem file; ``at`` and ``candidates`` as `design_of` has them.

    Raises:
        MbmError: the problem, the data or the call is wrong; not-designed, no-candidates, unknown-quantity.

    """
    problem = opened(path, sandbox=options.sandbox)
    if options.problem is not None:
        problem = problem.named(options.problem)
    return design_of(problem, inputs_of(options), at, candidates, wish)
