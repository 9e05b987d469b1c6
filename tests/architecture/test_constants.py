"""No number, text or list stands in two files under one name: it has one home, or names that say what each is for."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]


def _constants(path: Path) -> dict[tuple[str, str], None]:
    """Names in capitals that a file gives a literal value at its top level, with the values; numbers as floats."""
    found = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.Assign(targets=[target], value=value):
                pairs = [(target, value)]
                if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                    pairs = list(zip(target.elts, value.elts, strict=False))
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                pairs = [(target, value)]
            case _:
                continue
        for name, literal in pairs:
            if isinstance(name, ast.Name) and name.id.isupper():
                try:
                    known = ast.literal_eval(literal)
                except ValueError:
                    continue
                plain = isinstance(known, int | float) and not isinstance(known, bool)
                found[name.id, repr(float(known) if plain else known)] = None
    return found


def test_constants_are_found() -> None:
    assert ("LEAST_GAIN_RATIO", "0.0001") in _constants(ROOT / "mbm" / "solver" / "decisions.py")


def test_no_constant_stands_twice() -> None:
    """Those which two files share are imported; those which only look alike are named for what they mean."""
    homes = defaultdict(list)
    for path in sorted((ROOT / "mbm").rglob("*.py")):
        for constant in _constants(path):
            homes[constant].append(path.relative_to(ROOT).as_posix())
    twice = {f"{name} = {value[:40]}": files for (name, value), files in homes.items() if len(files) > 1}
    assert not twice
