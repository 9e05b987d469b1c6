"""How problems, compiled problems and estimators pickle: as the text and the data from which they are made again.

A pickle holds no code of mbm's and no machine code. Files that the text names are read again where it is loaded.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.api.compilation import Origin
from mbm.api.reading import Reading
from mbm.api.recall import Text
from mbm.compiler import Inputs
from mbm.files.journal import THE_PROBLEM, Journal, note, noting
from mbm.registry.standard import standard_registry
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.starts.closed_forms.types import ClosedForm


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """A problem of a text: ``file`` is what results call it, ``name`` which problem is meant (None: the only one)."""

    text: Text
    closed_forms: tuple[ClosedForm, ...]
    file: str | None
    name: str | None

    @classmethod
    def of(cls, origin: Origin) -> Written:
        """That of what is compiled."""
        return cls(text=origin.reading.text, closed_forms=origin.registry.given, file=origin.file, name=origin.name)

    def origin(self) -> Origin:
        """What is compiled."""
        journal = Journal()
        if self.file is not None:
            with noting(journal):
                note(Path(self.file), THE_PROBLEM)
        registry = standard_registry(self.closed_forms)
        return Origin(reading=Reading(self.text, registry, journal), registry=registry, file=self.file, name=self.name)


def portable(inputs: Inputs) -> Inputs:
    """The same in mappings that pickle."""
    return replace(inputs, tables=dict(inputs.tables), paths=dict(inputs.paths), overrides=dict(inputs.overrides))
