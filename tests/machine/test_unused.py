"""Fields that always have one value decide when a text is read, and what they leave without a use goes."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from mbm.machine import c
from mbm.machine.from_python import module_of
from mbm.machine.records import record
from mbm.machine.unused import without_unused
from mbm.machine.words import Integer, Reals


@record
class Extent:
    """Sizes."""

    n: Integer
    twice: Integer


def doubled(extent: Extent, values: Reals) -> Integer:
    """Doubles all values, if that is wanted; how many there are."""
    values[0] += 1.0
    return extent.n


def scaled(extent: Extent, values: Reals, other: Reals) -> Integer:
    """What `doubled` says."""
    own = extent
    count = own.n
    spare = count + 1
    unread = spare * 2
    kept = doubled(extent, values)  # noqa: F841 - that is what is looked at
    if own.twice == 1:
        for i in range(count):
            values[i] *= 2.0
    else:
        values[0] = other[unread]
    return count


def test_what_nothing_reads_goes_and_what_a_call_does_stays():
    module = without_unused(module_of("m", (scaled,), constants={"extent.n": 3, "extent.twice": 1}))
    text = c.text(module)
    assert "->n" not in text
    assert "->twice" not in text
    whole = text[text.index("scaled") :]
    assert "spare" not in whole
    assert "unread" not in whole
    assert "kept" not in whole
    assert "    doubled(extent, values);" in whole
    assert "(void)other;" in whole


def test_such_a_text_compiles_without_warnings(tmp_path):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler here")
    import ctypes

    module = without_unused(module_of("m", (scaled,), constants={"extent.n": 3, "extent.twice": 1}))
    text = c.text(module)
    (tmp_path / "m.c").write_text(c.prelude(text) + text)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, "-o", str(tmp_path / "m.so"), str(tmp_path / "m.c"), "-lm"], check=True)
    values = np.array([1.0, 2.0, 3.0, 4.0])
    library = ctypes.CDLL(str(tmp_path / "m.so"))
    library.scaled.restype = ctypes.c_long
    pointer = values.ctypes.data_as(ctypes.c_void_p)
    assert library.scaled(None, pointer, pointer) == 3
    assert values.tolist() == [4.0, 4.0, 6.0, 4.0]


def test_a_field_with_a_value_is_not_assigned():
    def assigned(extent: Extent) -> None:
        extent.n = 2

    with pytest.raises(Exception, match=r"extent\.n"):
        module_of("m", (assigned,), constants={"extent.n": 3})
