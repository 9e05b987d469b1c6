"""A text and the files it uses, read into definitions when somebody asks for them: a warm start never does."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbm import compiler
from mbm.api.recall import (
    Recalled,
    Text,
    key_of,
    known_text,
    recalled,
    remember,
    remember_starts,
    remember_text,
)
from mbm.compiler import Inputs
from mbm.files.journal import Journal, noting
from mbm.registry.standard import Registry

if TYPE_CHECKING:
    from mbm.equations.binding import Kind
    from mbm.language.session import Program


class Reading:
    """The definitions of a text, and what they compile to. Local to one loaded problem.

    ``journal`` names the files that were read for it: the text, those that it uses, tables.
    """

    def __init__(self, text: Text, registry: Registry, journal: Journal) -> None:
        self.text = text
        self.registry = registry
        self.journal = journal
        self._program: Program | None = None
        self._key: str | None = None
        self._digest: str | None = None

    def is_known(self) -> bool:
        """Whether the text was read without a fault before, in this process or another."""
        store = self.registry.store() if self._program is None and self._digest is None else None
        if store is not None:
            self._key = key_of(self.text)
            with noting(self.journal):
                self._digest = known_text(store, self._key)
        return self._program is not None or self._digest is not None

    @property
    def base(self) -> Path:
        """The folder that paths in the text are relative to."""
        return self.text.path.parent

    @property
    def program(self) -> Program:
        """The definitions.

        Raises:
            MbmError: the text, or one that it uses, is wrong.

        """
        if self._program is None:
            text = self.text
            with noting(self.journal):
                self._program = compiler.read(text.source, text.path, self.registry, text.sandbox)
        return self._program

    def compiled(self, name: str | None, inputs: Inputs) -> Recalled:
        """The equations of a problem (None: the only one) with their tables, and their kernels.

        Raises:
            MbmError: the problem or the data are wrong.

        """
        store = self.registry.store()
        if store is not None and self._digest is not None:
            with noting(self.journal):
                found = recalled(store, self._digest, name, self.base, inputs, self.registry)
            if found is not None:
                return replace(found, without_closed_form=()) if self.text.closed_forms else found
        with noting(self.journal):
            elaborated = compiler.elaborated(self.program, name, inputs, self.registry)
        kernels = compiler.derived(elaborated)
        key: str | None = None
        if store is not None:
            if self._digest is None or elaborated.read:  # another problem of the text may have read nothing
                self._digest = remember_text(store, self._key or key_of(self.text), self.program, elaborated.read)
            if self._digest is not None:
                key = remember(store, self._digest, name, inputs, elaborated, kernels)
        return Recalled(elaborated=elaborated, kernels=kernels, key=key)

    def learned(self, key: str, kinds: Collection[Kind], before: int) -> None:
        """Keep for which kinds of equations of an entry no closed form is made; there were ``before`` of them.

        Not where the caller brings closed forms: a form of the same name may do more the next time.
        """
        store = self.registry.store() if len(kinds) > before and not self.text.closed_forms else None
        if store is not None:
            remember_starts(store, key, kinds)
