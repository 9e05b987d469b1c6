"""No number, text or list stands in two files under one name: it has one home, or names that say what each is for."""

from __future__ import annotations

from collections import defaultdict

from tests.architecture.reading import FILES, ROOT, facts


def test_constants_are_found() -> None:
    assert ("LEAST_GAIN_RATIO", "0.0001") in facts(ROOT / "mbm" / "solver" / "decisions.py").constants


def test_no_constant_stands_twice() -> None:
    """Those which two files share are imported; those which only look alike are named for what they mean."""
    homes = defaultdict(list)
    for path in FILES:
        for constant in facts(path).constants:
            homes[constant].append(path.relative_to(ROOT).as_posix())
    twice = {f"{name} = {value[:40]}": files for (name, value), files in homes.items() if len(files) > 1}
    assert not twice
