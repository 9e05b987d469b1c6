"""Graphs of 121 to 300 unknowns: the sparse solver comes to the minimum that the dense one confirms."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.robust import test_trust
from tests.robust.test_trust import GRAPHS


@pytest.mark.parametrize("kind", GRAPHS)
@pytest.mark.parametrize("false", [0, 5])
def test_the_minimum_is_that_of_the_dense_solver_alone(kind: str, false: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With :method lm, that alone is taken; both end at offsets below 0.001 standard deviations."""
    monkeypatch.setattr(test_trust, "SIDE", 7 if kind == "plane" else 6)
    text, made = GRAPHS[kind]
    data, _, _ = made(false, 0)
    found, alone = (
        mbm.loads(text.format(robust=f"none {method}")).solve(data=data).first for method in ("", ":method lm")
    )
    assert found.cost == pytest.approx(alone.cost, rel=1e-6)
    assert found.method == alone.method == "lm"
    places = (each["T"].value[:, -2:] for each in (found, alone))
    assert np.ptp(np.stack(list(places)), axis=0).max() < 1e-3 * 0.05
    assert {each.code.name for each in found.diagnostics} == {each.code.name for each in alone.diagnostics}
