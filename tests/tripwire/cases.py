"""What is recorded: problems of this repository and problems made up, each solved on several paths.

Cases have names that stay; a case is an amount of text and data, of which the record keeps a digest: one whose text has
changed since is not compared.
"""

from __future__ import annotations

import functools
import hashlib
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import mbm
from mbm.api.problem import Problem
from tests.fuzz.kinds import NODES, READINGS, write_tables
from tests.fuzz.problems import problem_file

ROOT = Path(__file__).parents[2]
RANDOM = 5000
"""Random problems."""

METHODS = ("", "", "(solve :method gauss-newton)", "(solve :method dogleg)")
"""What may be said of the solution of those that are of the oracles' kinds."""

BYTES = 320
"""That decide a random problem."""

EVERY = ("native", "casadi", "numpy")
"""Backends: each is a path of its own today."""

MADE = 8
"""Of so many random problems one is solved by machine code too, which takes ten times as long to make."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One problem: ``load`` makes it, with its data; ``text`` is all that decides it, ``paths`` the backends asked."""

    name: str
    text: bytes
    load: Callable[[], tuple[Problem, dict]]
    paths: tuple[str, ...] = EVERY

    @property
    def digest(self) -> int:
        """Of the text: 63 bits."""
        return int.from_bytes(hashlib.sha256(self.text).digest()[:8], "big") >> 1


def cases(random: int = RANDOM, only: str = "") -> Iterator[Case]:
    """All cases whose names begin with ``only``, and so many random ones at most: those of the repository first."""
    groups: dict[str, Callable[[], Iterator[Case]]] = {
        "problems/": lambda: _files(sorted((ROOT / "problems").glob("*/*.mbm")), "problems", EVERY),
        "bad/": lambda: _files(sorted((ROOT / "tests" / "bad").glob("*.mbm")), "bad", ("numpy",)),
        "shapes/": _shapes,
        "undetermined/": _undetermined,
        "many/": _many,
        "kinds/": _kinds,
        "random/": lambda: map(_random, range(random)),
    }
    for group, made in groups.items():
        if group.startswith(only) or only.startswith(group):
            yield from (case for case in made() if case.name.startswith(only))


def _files(paths: list[Path], group: str, backends: tuple[str, ...]) -> Iterator[Case]:
    """The problems of files, with all that lies beside them."""
    for path in paths:
        try:
            names = mbm.load(path).names
        except mbm.MbmError:
            continue  # no problem, but a message that tests/bad looks at
        beside = b"".join(p.read_bytes() for p in sorted(path.parent.glob("*")) if p.suffix in (".csv", ".json"))
        for name in names:
            yield Case(
                name=f"{group}/{path.stem}/{name}",
                text=path.read_bytes() + (beside if group == "problems" else b"") + name.encode(),
                load=lambda path=path, name=name: (mbm.load(path).named(name), {}),
                paths=backends,
            )


def _text(name: str, text: str) -> Case:
    return Case(name=name, text=text.encode(), load=lambda: (mbm.loads(text), {}))


def _with_tables(name: str, text: str, data: dict) -> Case:
    return Case(name=name, text=text.encode() + _bytes_of(data), load=lambda: (mbm.loads(text), data))


def _shapes() -> Iterator[Case]:
    """Shapes that generated solvers have to take."""
    from tests.emit.agreeing import TEXTS, with_rows
    from tests.emit.shapes import SHAPES

    yield from (_text(f"shapes/{name}", text) for name, text in SHAPES.items())
    yield from (_text(f"shapes/{name}/other", with_rows(name, 1)) for name in TEXTS)


def _undetermined() -> Iterator[Case]:
    """What the data leave undetermined."""
    from tests.emit.test_undetermined import TEXTS

    yield from (_text(f"undetermined/{name}", f"(problem {name} {text})") for name, text in TEXTS.items())


def _many() -> Iterator[Case]:
    """Problems of `for-each` and `window`, with data of their own."""
    from tests.estimation.many.problems import PROBLEMS

    yield from (_with_tables(f"many/{name}", *each) for name, each in PROBLEMS.items())


def _kinds() -> Iterator[Case]:
    """The kinds of the oracles: one data set, and ten together."""
    from tests.oracles.catalogue import KINDS
    from tests.oracles.kinds import drawn
    from tests.oracles.paths import joined

    for name, kind in KINDS.items():
        sets = drawn(name, kind)
        yield _with_tables(f"kinds/{name}", kind.text(), sets[0])
        yield _with_tables(f"kinds/{name}/for-each", kind.text("(for-each set)"), joined(kind, sets))


def _bytes_of(data) -> bytes:
    """The columns of tables."""
    columns = [np.asarray(column) for table in data.values() for column in table.values()]
    return b"".join(c.tobytes() if c.dtype.kind in "fiub" else repr(c.tolist()).encode() for c in columns)


def _random(number: int) -> Case:
    """By turns new data of a kind of the oracles, by one method or another, and a text of the generator of tests/fuzz.

    The first mostly converge. The second mostly do not: they say what is said of problems that are ill-posed.
    """
    name, generator = f"random/{number}", np.random.default_rng([77, number])
    paths = ("numpy", "native") if number // 2 % MADE == 0 else ("numpy",)
    if number % 2 == 0:
        from tests.oracles.catalogue import KINDS

        kind = list(KINDS.values())[number // 2 % len(KINDS)]
        return replace(_with_tables(name, kind.text(generator.choice(METHODS)), kind.draw(generator)), paths=paths)
    text = problem_file(generator.bytes(BYTES))
    return Case(
        name=name,
        text=(text + NODES + READINGS).encode(),
        load=lambda: (mbm.loads(text, base=Path(_folder().name)).named("first"), {}),
        paths=paths,
    )


@functools.cache
def _folder() -> tempfile.TemporaryDirectory:
    """A folder with the tables that random problems read: one for each process, until it ends."""
    made = tempfile.TemporaryDirectory(prefix="mbm-tripwire-")
    write_tables(Path(made.name))
    return made
