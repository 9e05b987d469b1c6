"""The hostile cases as whole processes: those of `tests.hostile.kinds`, and attacks by size."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tests.hostile import kinds
from tests.hostile.command_lines import command_line
from tests.hostile.data_files import SOURCES
from tests.hostile.large_files import large_file
from tests.hostile.long_texts import long_text
from tests.hostile.odd_places import odd_place
from tests.trials.choices import Choices
from tests.trials.kinds import Case, Home, Kind
from tests.trials.processes import outcome_of_process

BYTES = 160


def home(folder: Path) -> Home:
    """An empty folder, in which each case is run as a process of its own.

    One is run before them, since the first that loads a module compiles it.
    """
    here = Home(folder=folder, processes=True)
    place = here.cleared("case")
    (place / "p.mbm").write_text("(problem p (unknowns (a :init 1)) (observe (= 1 a) :sigma 1))", encoding="utf-8")
    outcome_of_process("explain", "p.mbm", folder=place, devices=(), closed=())
    return here


def _any_of(some: Sequence[Kind], here: Home, choices: Choices) -> Case:
    return choices.one_of(some).make(here, choices)


def _named(*names: str) -> partial[Case]:
    return partial(_any_of, [kind for kind in kinds.KINDS if kind.name in names])


KINDS = (
    Kind(name="texts", share=0.14, size=BYTES, make=_named("hostile texts")),
    Kind(name="data files", share=0.14, size=BYTES, make=_named(*(f"hostile {kind}" for kind in SOURCES))),
    Kind(name="options", share=0.08, size=BYTES, make=_named("hostile options")),
    Kind(name="destinations", share=0.08, size=BYTES, make=_named("destinations", "confined problems")),
    Kind(name="long texts", share=0.22, size=BYTES, make=long_text),
    Kind(name="large files", share=0.16, size=BYTES, make=large_file),
    Kind(name="odd places", share=0.1, size=BYTES, make=odd_place),
    Kind(name="long command lines", share=0.08, size=BYTES, make=command_line),
)
