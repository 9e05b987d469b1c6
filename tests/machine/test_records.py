"""Records of the little language: as Python, as printed Python, as C with sanitizers and as machine code, all alike."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from mbm.machine import c, python
from mbm.machine.from_python import NotInTargetLanguageError, module_of
from mbm.machine.records import (
    Records,
    Reference,
    behind,
    blank,
    integers_in,
    lay_out,
    put,
    reals_in,
    record,
    sized,
    slots_of,
    table,
    view,
)
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


@record
class Part:
    """Some columns."""

    first: Integer
    last: Integer
    weights: ConstantIntegers = table()


@record
class Sizes:
    """How much there is of all."""

    n: Integer
    count: Integer
    chosen: ConstantIntegers = table()
    parts: Records[Part] = table()
    rest: ConstantIntegers = behind()


@record
class Point:
    """A point and what is known there."""

    cost: Real
    steps: Integer
    x: Reals = sized("n")
    square: Reals = sized("n * n")


@record
class Scale:
    """What a part counts."""

    factor: Real
    shift: Real


@record
class Room:
    """All there is."""

    sizes: Reference[Sizes]
    reals: Reals
    integers: Integers
    scales: Records[Scale]
    first: Point
    second: Point
    here: Reference[Point]
    there: Reference[Point]
    order: Integers = sized("n + 1")
    total: Real


def room_reals(sizes: Sizes) -> Integer:
    """Reals of a room."""
    return reals_in(Room, sizes)


def room_integers(sizes: Sizes) -> Integer:
    """Integers of a room."""
    return integers_in(Room, sizes)


def begin(sizes: Sizes, room: Room) -> None:
    """Everything in its place."""
    room.sizes = sizes
    lay_out(room, sizes, room.reals, room.integers)
    room.here = room.first
    room.there = room.second
    room.total = 0.0
    for i in range(sizes.n):
        room.first.x[i] = float(sizes.chosen[i])
        room.second.x[i] = 0.5
        room.order[i] = sizes.n - i
    room.first.steps = 0
    room.second.steps = 0


def weigh(sizes: Sizes, b: Integer, point: Point) -> Real:
    """The weighted sum of the columns of a part."""
    part = sizes.parts[b]
    found = 0.0
    for k in range(part.first, part.last):
        found += float(part.weights[k - part.first]) * point.x[k]
    return found


def go(room: Room, times: Integer, out: Reals) -> Integer:
    """To and fro between the points."""
    sizes = room.sizes
    for _ in range(times):
        here = room.here
        there = room.there
        there.cost = 0.0
        for b in range(sizes.count):
            scale = room.scales[b]
            there.cost += scale.factor * weigh(sizes, b, here) + float(sizes.rest[0])
            room.scales[b].shift += 1.0
            if sizes.parts[b].last > sizes.parts[b].first + 2:
                there.cost -= 0.25
        for i in range(sizes.n):
            there.x[i] = here.x[sizes.n - 1 - i] + 0.125 * there.cost
            there.square[i * sizes.n + i] = there.x[i]
        there.steps = here.steps + 1
        room.total += there.cost
        room.here = there
        room.there = here
    for i in range(sizes.n):
        out[i] = room.here.x[i]
    out[sizes.n] = room.total + room.scales[1].shift
    return room.here.steps + room.order[0] + room.first.steps


ROOTS = (begin, go, room_reals, room_integers)
MODULE = module_of("records", ROOTS)


def sizes_array():
    """A record of sizes with its tables: n, count, chosen, parts | 7 | two parts | chosen | weights."""
    head, parts = [3, 2, 0, 0, 7], [[0, 2, 0], [1, 3, 0]]
    head[2], head[3] = 5 + 6, 5
    chosen, weights = [4, 6, 8], [[2, 3], [5, 7]]
    for k, part in enumerate(parts):
        part[2] = 11 + 3 + 2 * k - (5 + 3 * k)
    return np.array([*head, *parts[0], *parts[1], *chosen, *weights[0], *weights[1]], dtype=np.int64)


def scales_array():
    """Of each part: factor and shift."""
    return np.array([1.0, 0.25, 1.0, 0.5])


def as_it_stands():
    """What Python makes of the text."""
    sizes, room = view(Sizes, sizes_array()), Room()
    room.scales = Records(Scale, scales_array())
    room.reals = np.zeros(room_reals(sizes))
    room.integers = np.zeros(room_integers(sizes), dtype=np.int64)
    begin(sizes, room)
    out = np.zeros(4)
    return go(room, 3, out), out


def by_address(address):
    """What machine code makes of it, in memory for a room."""
    pointer, whole = ctypes.c_void_p, ctypes.c_int64
    array, out, memory = sizes_array(), np.zeros(4), blank(Room)
    reals = np.zeros(ctypes.CFUNCTYPE(whole, pointer)(address("room_reals"))(array.ctypes.data))
    integers = np.zeros(ctypes.CFUNCTYPE(whole, pointer)(address("room_integers"))(array.ctypes.data), dtype=np.int64)
    scales = scales_array()
    put(memory, Room, reals=reals, integers=integers, scales=scales)
    ctypes.CFUNCTYPE(None, pointer, pointer)(address("begin"))(array.ctypes.data, memory.ctypes.data)
    go_on = ctypes.CFUNCTYPE(whole, pointer, whole, pointer)(address("go"))
    return go_on(memory.ctypes.data, 3, out.ctypes.data), out


def test_python_finds_what_is_computed_by_hand():
    state, out = as_it_stands()
    # 2·4 + 3·6 + 5·6 + 7·8 + 2·7 = 126 from the first point; x becomes the reversed one plus an eighth of it
    assert out[3] > 126.0 + 0.5 + 3.0  # and the shift, one more each time
    assert state == 3 + 3 + 2


def test_printed_python():
    names = {}
    exec(python.PRELUDE + python.text(MODULE), names)  # noqa: S102 - its own text
    sizes, room, out = sizes_array(), names["Room"](), np.zeros(4)
    room.reals, room.integers = np.zeros(names["room_reals"](sizes)), np.zeros(names["room_integers"](sizes), dtype=int)
    room.scales = scales_array()
    names["begin"](sizes, room)
    state = names["go"](room, 3, out)
    assert (state, out.tolist()) == (as_it_stands()[0], as_it_stands()[1].tolist())


@pytest.mark.parametrize("flags", [(), ("contract",)])
def test_machine_code(flags):
    pytest.importorskip("llvmlite")
    from mbm.kernels.native.engine import compiled
    from mbm.machine import llvm

    written = llvm.text(MODULE, flags)
    for level in (0, 2):
        state, out = by_address(compiled(written, None, level).address)
        np.testing.assert_allclose(out, as_it_stands()[1], rtol=0 if not flags else 1e-15)
        assert state == as_it_stands()[0]


MAIN = """
#include <stdio.h>
int main(void)
{
    static long sizes[] = {%s};
    static double reals[100], out[4], scales[] = {%s};
    static long integers[100];
    static struct room room;
    long state;

    room.reals = reals;
    room.integers = integers;
    room.scales = (struct scale *)scales;
    if (room_reals((struct sizes *)sizes) > 100 || room_integers((struct sizes *)sizes) > 100)
        return 1;
    begin((struct sizes *)sizes, &room);
    state = go(&room, 3, out);
    printf("%%ld %%.17g %%.17g %%.17g %%.17g\\n", state, out[0], out[1], out[2], out[3]);
    return 0;
}
"""


def test_c_with_every_warning_and_sanitizer(tmp_path):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler here")
    main = MAIN % tuple(", ".join(str(value) for value in each) for each in (sizes_array(), scales_array()))
    (tmp_path / "r.c").write_text(c.prelude(c.text(MODULE) + main) + c.text(MODULE) + main)
    flags = ["-std=c99", "-O1", "-g", "-Wall", "-Wextra", "-pedantic", "-Werror", "-Wno-unused-function"]
    sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = [compiler, *flags, *sanitizers, str(tmp_path / "r.c"), "-o", str(tmp_path / "r"), "-lm"]
    subprocess.run(command, check=True)
    printed = subprocess.run([str(tmp_path / "r")], check=True, capture_output=True, text=True).stdout.split()
    state, out = as_it_stands()
    assert [float(each) for each in printed] == [state, *out.tolist()]


def test_c_reads_as_written():
    text = c.text(MODULE)
    assert (
        "struct room {\n    struct sizes *sizes;\n    double *reals;\n    long *integers;\n    struct scale *scales;\n"
        "    struct point first;" in text
    )
    assert "there->x[i] = here->x[sizes->n - 1L - i] + 0.125 * there->cost;" in text
    assert "room->first.x[i] = (double)chosen_of_sizes(sizes)[i];" in text
    assert "part = &parts_of_sizes(sizes)[b];" in text
    assert "room->here = &room->first;" in text


def test_the_class_has_the_places_of_its_fields_and_an_instance_what_stands_there():
    array = sizes_array()
    sizes = view(Sizes, array)
    assert (Sizes.n, Sizes.parts, slots_of(Sizes), slots_of(Part)) == (0, 3, 4, 3)
    assert array[Sizes.count] == sizes.count == 2
    sizes.count = 1
    assert array[Sizes.count] == 1
    assert sizes.parts[1].last == 3
    # two points of four slots, three references, four arrays and a number
    assert slots_of(Room) == 2 * 4 + 3 + 4 + 1
    assert reals_in(Room, sizes) == 2 * (3 + 9)
    assert integers_in(Room, sizes) == 4


def without_field(point: Point) -> Real:
    """Names what is not there."""
    return point.nothing


def with_table(sizes: Sizes, values: ConstantReals) -> None:
    """A table is where it is."""
    sizes.chosen = values


@pytest.mark.parametrize("wrong", [without_field, with_table])
def test_what_records_do_not_have_is_refused(wrong):
    with pytest.raises(NotInTargetLanguageError):
        module_of("wrong", [wrong])
