"""A misspelt name → the name that was meant."""

import pytest

from mbm.text.suggest import closest, edit_distance


@pytest.mark.parametrize(
    ("name", "candidates", "expected"),
    [
        ("rotat", ["rotate", "rot2", "translate"], "rotate"),
        ("lenght", ["length", "height"], "length"),
        ("Psi", ["phi", "psi"], "psi"),
        ("PSI", ["psi", "Psi"], "Psi"),
        ("x", ["y", "X"], "X"),
        ("x", ["y", "z"], None),
        ("sigma", ["sigma"], None),
        ("receiver", ["receivers", "receivr"], "receivers"),
        ("foo", ["quaternion", "bar"], None),
        ("", ["a"], None),
    ],
)
def test_the_nearest_candidate_is_suggested(name, candidates, expected):
    assert closest(name, candidates) == expected
    assert closest(name, reversed(candidates)) == expected


@pytest.mark.parametrize(
    ("a", "b", "distance"),
    [("ca", "abc", 3), ("kitten", "sitting", 3), ("ab", "ba", 1), ("", "abc", 3), ("abc", "abc", 0)],
)
def test_distances_are_those_of_the_restricted_damerau_distance(a, b, distance):
    assert edit_distance(a, b, 10) == distance


def test_a_distance_beyond_the_limit_is_only_known_to_be_beyond():
    assert edit_distance("aaaaaaaa", "bbbbbbbb", 2) > 2


@pytest.mark.parametrize(("name", "meant"), [("!=", "(not (= a b))"), ("**", "^"), ("=<", "<=")])
def test_operators_of_other_languages(name, meant):
    assert closest(name, ["<=", ">=", "=", "*", "^", "<"]) == meant
