"""Documents as text: what JSON reads back, lines that people can read, numbers that JSON does not have."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbm.report.encode import WIDEST_LINE, encode


def tree(generator, depth):
    """A random tree of everything that documents hold."""
    if depth == 0 or generator.random() < 0.3:
        atoms = [1, -2.5, 1e-300, True, False, None, 'a "quoted"\nline é', "x" * int(generator.integers(150)), 10**20]
        atoms += [float(generator.standard_normal()), [], {}]
        return atoms[int(generator.integers(len(atoms)))]
    size = int(generator.integers(9))
    if generator.random() < 0.5:
        return [tree(generator, depth - 1) for _ in range(size)]
    return {f"name {i}": tree(generator, depth - 1) for i in range(size)}


@pytest.mark.parametrize("seed", range(40))
def test_json_reads_back_what_was_written(seed):
    value = tree(np.random.default_rng(seed), 4)
    assert json.loads(encode(value)) == value


def test_floats_keep_all_digits():
    numbers = np.random.default_rng(1).standard_normal(200).tolist()
    assert json.loads(encode(numbers)) == numbers


def test_numbers_of_a_long_list_fill_lines():
    lines = encode({"values": list(np.linspace(0, 1, 60))}).splitlines()
    assert len(lines) < 20
    assert all(len(line) <= WIDEST_LINE + len("    ,") for line in lines)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), np.float64("nan")])
def test_numbers_that_json_does_not_have_are_refused(value):
    with pytest.raises(ValueError, match="not JSON compliant"):
        encode({"a": [1.0, value]})


def test_arrays_are_refused():
    with pytest.raises(TypeError):
        encode(np.zeros(3))
