"""What the files of a solver say of it in words: a sentence that holds for one problem does not stand in the others."""

from __future__ import annotations

import pytest

from mbm.emit.foreign import Foreign
from mbm.emit.python.kernels import DIALECT
from mbm.emit.statements import statements
from mbm.machine.program import Instruction, Operator, Program
from tests.emit.making import of_text
from tests.emit.shapes import SHAPES


def files(name: str) -> dict[str, str]:
    return {file.path: file.content.decode() for file in of_text(SHAPES[name], "c")}


@pytest.mark.parametrize(
    ("sentence", "those", "others"),
    [
        ("One call solves one data set: the rows that agree in `day`.", ("for-each",), ("plain",)),
        ("begins where the data say", ("startless", "unstarted"), ("plain", "levelling", "both")),
        ("begins at the answer for the data", ("similarity",), ("plain", "startless")),
        ("which measurements agree; the others are left out.", ("startless", "levelling"), ("unstarted", "bounded")),
        ("where the losses' lowest minimum is", ("bounded",), ("levelling", "unstarted")),
    ],
)
def test_the_readme(sentence, those, others):
    assert [name for name in (*those, *others) if sentence in files(name)["README.md"]] == list(those)


def test_the_header_says_how_many_numbers_a_start_takes():
    assert "begins: a number for each member; NULL" in files("family")["family.h"]
    assert "begins: a number; NULL" in files("plain")["plain.h"]
    assert "begins: 4 numbers; NULL" in files("rotation")["rotation.h"]


def test_inputs_that_no_output_needs_are_not_declared():
    squares = Program(
        values=3, inputs=(0, 1, -1), constants=(), instructions=(Instruction(2, Operator.MUL, (0, 0)),), outputs=(2,)
    )
    made = statements(squares, [Foreign("a"), Foreign("b"), Foreign("c")], DIALECT)
    assert made.inputs == (("a", 0),)
