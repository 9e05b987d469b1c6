"""What the page of the feature matrix says is what mbm does."""

from __future__ import annotations

import pytest

from tests.oracles.matrix import AGREES, FEATURES, METHODS, NONE, PATHS, measured, on_the_page

QUICK = ("single", "for-each", "window", "stream")
"""Paths whose cells take a tenth of a second; generated solvers are compiled, and large problems are large."""

CELLS = on_the_page()


def held(method: str, feature: str, paths) -> list[str]:
    """The cells that are other than the page says."""
    wrong = []
    for path in paths:
        found, said = measured(method, feature, path), CELLS[method, feature, path]
        if found != said:
            wrong.append(f"{method}, {feature}, {path}: {found}, and the page says {said}")
    return wrong


def test_the_page_is_whole():
    assert set(CELLS) == {(method, feature, path) for method in METHODS for feature in FEATURES for path in PATHS}


def test_the_usual_method_leaves_nothing_open():
    """Where it refuses, the page says with what; everywhere else it agrees with SciPy."""
    assert {mark for (method, _, _), mark in CELLS.items() if method == "auto"} <= {AGREES, NONE}


@pytest.mark.parametrize("feature", FEATURES)
def test_the_usual_method_does_what_the_page_says(feature):
    assert held("auto", feature, QUICK) == []


@pytest.mark.slow
@pytest.mark.parametrize("feature", FEATURES)
def test_every_method_does_what_the_page_says(feature):
    assert [fault for method in METHODS for fault in held(method, feature, QUICK)] == []


@pytest.mark.slow
@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("method", METHODS)
def test_generated_and_large_ones_too(method, feature):
    assert held(method, feature, [path for path in PATHS if path not in QUICK]) == []
