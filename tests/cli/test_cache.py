"""``mbm cache``: what it says about the folder, and what it removes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mbm.kernels.store import Store

Run = Callable[..., Any]


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    monkeypatch.setenv("MBM_CACHE", str(tmp_path / "cache"))
    return Store(directory=tmp_path / "cache")


def test_an_empty_cache_is_shown_and_not_made(mbm: Run, store: Store) -> None:
    outcome = mbm("cache")
    assert outcome.status == 0
    assert outcome.out == f"{store.directory}\n  0 entries, 0 B\n"
    assert not store.directory.exists()


def test_the_kinds_are_counted(mbm: Run, store: Store) -> None:
    store.put("object", "a" * 64, bytes(3000))
    store.put("object", "b" * 64, bytes(1))
    store.put("problem", "c" * 64, bytes(2))
    found = json.loads(mbm("cache", "--json", "-").out)
    assert found["path"] == str(store.directory)
    assert found["entries"] == 3
    assert {kind: each["entries"] for kind, each in found["kinds"].items()} == {"object": 2, "problem": 1}
    assert found["bytes"] == sum(path.stat().st_size for path in store.directory.glob("*/*"))
    assert found["bytes"] == sum(each["bytes"] for each in found["kinds"].values())
    lines = mbm("cache").out.splitlines()
    assert lines[1].startswith("  3 entries, 3.")
    assert lines[1].endswith(" kB")
    assert [line.split()[:2] for line in lines[2:]] == [["object", "2"], ["problem", "1"]]


def test_clear_removes_what_is_there_and_says_so(mbm: Run, store: Store, tmp_path: Path) -> None:
    store.put("object", "a" * 64, b"x")
    outcome = mbm("cache", "clear", "--json", tmp_path / "gone.json")
    assert outcome.status == 0
    assert "removed 1 entry" in outcome.out
    assert json.loads((tmp_path / "gone.json").read_text(encoding="utf-8"))["entries"] == 1
    assert store.entries() == ()
    assert mbm("cache", "clear").status == 0


def test_a_cache_that_is_switched_off_is_none(mbm: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MBM_CACHE", "off")
    assert mbm("cache").out.startswith("no cache")
    found = json.loads(mbm("cache", "clear", "--json", "-").out)
    assert found == {"path": None, "entries": 0, "bytes": 0, "kinds": {}, "unused": []}


def test_quiet_says_nothing_and_other_words_are_refused(mbm: Run, store: Store) -> None:
    assert mbm("cache", "-q").out == ""
    assert mbm("cache", "purge").status == 2
    assert mbm("cache", "--json", store.directory / "none" / "x.json").status == 2


def test_a_folder_that_is_not_used_is_said_with_what_mends_it(mbm: Run, store: Store) -> None:
    store.put("object", "a" * 64, b"x")
    store.put("problem", "b" * 64, b"y")
    (store.directory / "object").chmod(0o770)
    lines = mbm("cache").out.splitlines()
    assert lines[1] == "  1 entry, " + lines[1].partition(", ")[2]
    assert lines[3:] == [f"  object: not used: others may write to it; mend: chmod go-w {store.directory / 'object'}"]
    assert json.loads(mbm("cache", "clear", "--json", "-").out)["unused"] == [
        {"path": str(store.directory / "object"), "reason": "others may write to it"}
    ]
    store.directory.chmod(0o777)
    outcome = mbm("cache", "clear")
    assert outcome.status == 0
    assert outcome.out.splitlines()[1:] == [
        "  removed 0 entries, 0 B",
        f"  not used: others may write to it; mend: chmod go-w {store.directory}",
    ]
    (store.directory / "object").chmod(0o700)
    store.directory.chmod(0o700)
    assert store.get("object", "a" * 64) == b"x"


def test_a_link_is_not_used_either(mbm: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a b").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "a b")
    monkeypatch.setenv("MBM_CACHE", str(tmp_path / "link"))
    assert mbm("cache").out.splitlines()[2:] == ["  not used: it is a link; remove it, or name a folder with MBM_CACHE"]
    (tmp_path / "a b").chmod(0o777)
    monkeypatch.setenv("MBM_CACHE", str(tmp_path / "a b"))
    assert mbm("cache").out.endswith(f"; mend: chmod go-w '{tmp_path / 'a b'}'\n")
