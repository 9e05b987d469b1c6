"""What differs between the loops of Python and those of C is refused."""

from __future__ import annotations

import pytest

from mbm.machine import c
from mbm.machine.from_python import NotInTargetLanguageError, module_of
from mbm.machine.words import Integer


def with_variable_behind_its_loop(n: Integer) -> Integer:
    """In Python it is the last one, in C the one after that."""
    for i in range(n):
        if i == 3:
            break
    return i


def with_variable_in_the_next_range(n: Integer) -> Integer:
    """Likewise."""
    found = 0
    for i in range(n):
        found += i
    for j in range(i):
        found += j
    return found


def with_variable_taken_again(n: Integer) -> Integer:
    """What is assigned anew may be read."""
    found = 0
    for i in range(n):
        found += i
    i = found
    for j in range(i):
        found += j
    for i in range(n):
        found += i
    return found


@pytest.mark.parametrize("wrong", [with_variable_behind_its_loop, with_variable_in_the_next_range])
def test_a_variable_is_not_read_behind_its_loop(wrong):
    with pytest.raises(NotInTargetLanguageError):
        module_of("wrong", [wrong])


def test_a_variable_may_be_taken_again():
    assert "with_variable_taken_again" in c.text(module_of("right", [with_variable_taken_again]))
