"""Problems that call their formulas as functions in Python, on every path, against SciPy."""

from __future__ import annotations

import pytest

from tests.oracles.called import called
from tests.oracles.catalogue import KINDS
from tests.oracles.kinds import drawn
from tests.oracles.matrix import FEATURES, METHODS, PATHS, SETS
from tests.oracles.outside import faults, outside

QUICK, OTHERS = ("single", "for-each"), ("window", "stream")


def wrong(feature: str, path: str, method: str = "auto", *, batches: bool) -> list[str]:
    """Where the answers are others than SciPy's, as the feature matrix counts it."""
    of = FEATURES[feature]
    plain = KINDS[of.kind]
    kind = called(plain, batches=batches)
    if (path == "stream" and kind.given is None) or (path == "large" and not kind.scatters):
        return []
    sets = drawn(of.kind, plain, SETS)
    said = " ".join((*(() if method == "auto" else (f":method {method}",)), of.options)).strip()
    answers = PATHS[path](kind, sets, f"(solve {said})" if said else "")
    return [fault for s, a in zip(sets, answers, strict=True) for fault in faults(plain, s, a, outside(plain, s))]


@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("path", QUICK)
def test_functions_that_are_differenced(feature, path):
    assert wrong(feature, path, batches=False) == []


@pytest.mark.slow
@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("path", OTHERS)
def test_functions_that_are_differenced_on_other_paths(feature, path):
    assert wrong(feature, path, batches=False) == []


@pytest.mark.slow
@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("path", (*QUICK, *OTHERS))
def test_functions_of_all_rows_with_jacobians(feature, path):
    assert wrong(feature, path, batches=True) == []


@pytest.mark.slow
@pytest.mark.parametrize("feature", FEATURES)
def test_large_problems(feature):
    assert wrong(feature, "large", batches=True) == []


@pytest.mark.slow
@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("method", METHODS)
def test_every_method(method, feature):
    assert wrong(feature, "single", method, batches=False) == []
