"""Closed forms of the caller, of installed packages and of mbm, in the order in which they are tried."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mbm.estimation.starts.closed_forms.multilateration import MULTILATERATION
from mbm.estimation.starts.closed_forms.standard import STANDARD
from mbm.registry import plug_ins
from mbm.registry.standard import CLOSED_FORMS, standard_registry


class Announced:
    """An entry point as a package would announce it."""

    def __init__(self, name: str) -> None:
        self.name = name

    def load(self) -> object:
        return replace(MULTILATERATION, name=self.name)


def test_the_callers_come_first_then_those_of_packages_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def entry_points(group: str) -> list[Announced]:
        return [Announced("zulu"), Announced("alpha")] if group == CLOSED_FORMS else []

    monkeypatch.setattr(plug_ins, "entry_points", entry_points)
    found = standard_registry((replace(MULTILATERATION, name="mine"),)).closed_forms()
    assert [form.name for form in found] == ["mine", "alpha", "zulu", *(form.name for form in STANDARD)]


def test_names_are_distinct() -> None:
    names = [form.name for form in STANDARD]
    assert len(set(names)) == len(names)
