"""Noise that rows and clauses share: ``(unknown FORM :as NAME)``."""

from __future__ import annotations

from collections.abc import Iterable

from mbm.language import faults as language_faults
from mbm.problem import faults
from mbm.problem.noise import PLAIN, NoiseStructure
from mbm.problem.options import Options, split_options
from mbm.problem.types import Block, Request
from mbm.text.types import Form, MbmError, Sequence, Symbol
from mbm.values import dataclass

USAGE = ":sigma (unknown FORM [:as NAME])"


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownNoise:
    """``(unknown FORM :as NAME)``: what the factor multiplies, and what it is called where clauses share it."""

    form: Form
    shared: Symbol | None


def read_unknown_noise(form: Sequence) -> UnknownNoise:
    """The noise that ``(unknown FORM [:as NAME])`` states.

    Raises:
        MbmError: not one form, or a name that is none.

    """
    options = split_options(form.items[1:], form.span, owner="`unknown`", known=("as",))
    name = options.get("as")
    if len(options.positional) != 1:
        raise MbmError(language_faults.bad_form(form.span, "`unknown` takes one form", USAGE))
    if name is not None and not isinstance(name, Symbol):
        raise MbmError(language_faults.bad_form(name.span, "`:as` takes a name", USAGE))
    return UnknownNoise(form=options.positional[0], shared=name)


def read_structure(options: Options) -> NoiseStructure:
    """What the options of an ``observe`` clause say of noise that rows share."""
    form = options.get("sigma")
    shared = read_unknown_noise(form).shared if isinstance(form, Sequence) and form.head == "unknown" else None
    return PLAIN if shared is None else NoiseStructure(shared=shared.name, place=shared.span)


def check_structures(blocks: Iterable[Block], request: Request | None) -> None:
    """Raise the names of shared factors that clauses have, and outlier rules, which look at each row by itself.

    Raises:
        MbmError: `noise-name-taken`, `noise-not-combined`.

    """
    every = tuple(blocks)
    clauses = {block.name: block.span for block in every}
    found = []
    for block in every:
        name, place = block.structure.shared, block.structure.place or block.span
        if name is None:
            continue
        if name in clauses:
            found.append(faults.noise_name_taken(place, name, clauses[name]))
        rule = ":loss" if block.loss is not None else ":robust" if request is not None and request.robust else None
        if rule is not None:
            found.append(faults.noise_beside_rule(place, block.name, f"the factor `{name}`", rule))
    if found:
        raise MbmError(*found)
