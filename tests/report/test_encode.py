"""Documents as text: what JSON reads back, lines that people can read, numbers that JSON does not have."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mbm.report.encode import WIDEST_LINE, encode, to_bytes

TEXTS = st.text(st.characters())
"""Any code points, halves of surrogate pairs among them."""


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


@given(st.dictionaries(TEXTS, st.one_of(TEXTS, st.lists(TEXTS)), max_size=5))
def test_texts_are_the_same_to_a_program_and_harmless_on_a_terminal(value):
    text = encode(value)
    assert json.loads(text) == value
    assert json.loads(to_bytes(text)) == value
    assert all(line.isprintable() for line in text.split("\n"))


def test_what_can_be_read_is_not_escaped():
    assert encode("größe “日本” 👍") == '"größe “日本” 👍"\n'


@pytest.mark.parametrize(
    ("text", "escaped"),
    [
        ("\x1b]0;x\x07", r"\u001b]0;x\u0007"),
        ("\x7f\x9b", r"\u007f\u009b"),
        ("a\u202eb\u2028", r"a\u202eb\u2028"),
        ("\udc80", r"\udc80"),
        ("\U000e0041", r"\udb40\udc41"),
        ('"\\\n\t', r"\"\\\n\t"),
    ],
)
def test_escapes_are_those_of_json(text, escaped):
    assert encode(text) == f'"{escaped}"\n'
