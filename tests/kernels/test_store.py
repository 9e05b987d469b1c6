"""The store of entries: what comes out is what went in, or nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from mbm.kernels import store as stores
from mbm.kernels.store import STALE, Store, standard_store

KEY = "ab" * 32


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(directory=tmp_path / "cache")


def _file(store: Store) -> Path:
    (entry,) = store.entries()
    return entry.path


def test_what_was_put_is_found_under_its_kind_and_key_only(store: Store) -> None:
    store.put("object", KEY, b"\x00code\n")
    assert store.get("object", KEY) == b"\x00code\n"
    assert store.get("problem", KEY) is None
    assert store.get("object", "cd" * 32) is None
    store.put("object", KEY, b"")
    assert store.get("object", KEY) == b""


@pytest.mark.parametrize("name", ["", "../up", "a/b", "A", ".", "a b", "-"])
def test_a_name_that_could_leave_the_folder_is_refused(store: Store, name: str) -> None:
    with pytest.raises(ValueError):
        store.put(name, KEY, b"x")
    with pytest.raises(ValueError):
        store.get("object", name)


@pytest.mark.parametrize("kept", [0, 5, 20, 60, -1])
def test_a_file_that_is_cut_off_is_no_entry_and_goes(store: Store, kept: int) -> None:
    store.put("object", KEY, b"content" * 10)
    path = _file(store)
    path.write_bytes(path.read_bytes()[:kept])
    assert store.get("object", KEY) is None
    assert not path.exists()


def test_any_changed_byte_is_noticed(store: Store) -> None:
    store.put("object", KEY, b"content")
    path = _file(store)
    whole = path.read_bytes()
    for position in range(len(whole)):
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 1]) + whole[position + 1 :])
        assert store.get("object", KEY) is None
        assert not path.exists()


def test_an_entry_moved_to_another_key_is_none(store: Store) -> None:
    store.put("object", KEY, b"for one processor")
    other = "cd" * 32
    _file(store).rename(store.directory / "object" / f"{other}.entry")
    assert store.get("object", other) is None


def test_an_entry_of_another_version_is_none(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(stores, "_HEADER", b"mbm-cache 1 0.0.1\n")
        store.put("object", KEY, b"old")
        assert store.get("object", KEY) == b"old"
    assert store.get("object", KEY) is None


def test_the_folder_is_bounded_and_what_was_used_last_stays(tmp_path: Path) -> None:
    store = Store(directory=tmp_path, limit=10_000)
    keys = [sha256(bytes([i])).hexdigest() for i in range(8)]
    for age, key in enumerate(reversed(keys[:4])):
        store.put("object", key, bytes(2_000))
        path = tmp_path / "object" / f"{key}.entry"
        os.utime(path, (path.stat().st_mtime - 100 - age,) * 2)
    assert store.get("object", keys[0]) is not None  # the oldest until now
    for key in keys[4:6]:
        store.put("problem", key, bytes(2_000))
    assert sum(entry.size for entry in store.entries()) <= 10_000
    held = {entry.path.stem for entry in store.entries()}
    assert {keys[0], keys[4], keys[5]} <= held
    assert keys[1] not in held


def test_what_is_larger_than_the_bound_is_not_kept_and_costs_nothing_else(tmp_path: Path) -> None:
    store = Store(directory=tmp_path, limit=1_000)
    store.put("object", KEY, bytes(500))
    store.put("object", "cd" * 32, bytes(1_000))
    assert store.get("object", KEY) == bytes(500)
    assert store.get("object", "cd" * 32) is None


def test_left_over_files_of_dead_processes_go_in_time(tmp_path: Path) -> None:
    store = Store(directory=tmp_path, limit=1_000)  # so small that the folder is looked through after each entry
    store.put("object", KEY, b"x")
    old, new = (store.directory / "object" / f"{KEY}.{n}.part" for n in ("1", "2"))
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1.0, new.stat().st_mtime - STALE - 10))
    store.put("object", "cd" * 32, b"y")
    assert not old.exists()
    assert new.exists()


def test_clear_removes_entries_and_nothing_else(store: Store) -> None:
    store.put("object", KEY, b"x")
    store.put("problem", KEY, b"yy")
    mine = store.directory / "object" / "notes.txt"
    mine.write_text("mine", encoding="utf-8")
    (store.directory / "photos").mkdir()
    (store.directory / "photos" / "a.jpg").write_bytes(b"jpg")
    assert [entry.kind for entry in store.clear()] == ["object", "problem"]
    assert store.entries() == ()
    assert mine.exists()
    assert (store.directory / "photos" / "a.jpg").exists()
    assert store.get("object", KEY) is None


def test_only_the_user_may_read_what_is_kept(store: Store) -> None:
    before = os.umask(0)
    try:
        store.put("object", KEY, b"x")
    finally:
        os.umask(before)
    path = _file(store)
    assert [p.stat().st_mode & 0o777 for p in (path, path.parent, store.directory)] == [0o600, 0o700, 0o700]


def test_a_folder_that_others_may_write_to_is_not_trusted(store: Store) -> None:
    store.put("object", KEY, b"x")
    (store.directory / "object").chmod(0o777)
    assert store.get("object", KEY) is None
    store.put("object", "cd" * 32, b"y")
    (store.directory / "object").chmod(0o700)
    assert store.get("object", KEY) == b"x"
    assert store.get("object", "cd" * 32) is None


def test_links_are_not_followed(store: Store, tmp_path: Path) -> None:
    store.put("object", KEY, b"x")
    path = _file(store)
    outside = tmp_path / "outside"
    path.rename(outside)
    path.symlink_to(outside)
    assert store.get("object", KEY) is None
    elsewhere = Store(directory=tmp_path / "elsewhere")
    elsewhere.put("object", KEY, b"theirs")
    (store.directory / "problem").symlink_to(elsewhere.directory / "object")
    assert store.get("problem", KEY) is None
    store.put("problem", KEY, b"mine")
    store.clear()
    assert elsewhere.get("object", KEY) == b"theirs"
    assert outside.read_bytes().endswith(b"x")


def test_the_standard_place_follows_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def place() -> Path | None:
        found = standard_store()
        return None if found is None else found.directory

    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("MBM_CACHE", raising=False)
    assert place() == tmp_path / ".cache" / "mbm"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert place() == tmp_path / ".cache" / "mbm"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "x"))
    assert place() == tmp_path / "x" / "mbm"
    monkeypatch.setenv("MBM_CACHE", str(tmp_path / "own"))
    assert place() == tmp_path / "own"
    monkeypatch.setenv("MBM_CACHE", "off")
    assert place() is None
    assert list(tmp_path.iterdir()) == []  # looking makes nothing


def test_where_nothing_can_be_written_there_is_no_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("a file", encoding="utf-8")
    monkeypatch.setenv("MBM_CACHE", str(blocked))
    assert standard_store() is None
    monkeypatch.setenv("MBM_CACHE", str(blocked / "below"))
    assert standard_store() is None
    store = Store(directory=blocked / "below")
    store.put("object", KEY, b"x")
    assert store.get("object", KEY) is None
    assert store.entries() == store.clear() == ()


WORKER = """
import sys
from hashlib import sha256
from pathlib import Path
from mbm.kernels.store import Store

store = Store(directory=Path(sys.argv[1]), limit=60_000)
for turn in range(60):
    key = sha256(b"%d" % (turn % 12)).hexdigest()
    content = key.encode() * 100
    found = store.get("object", key)
    if found is not None and found != content:
        sys.exit(f"{key}: torn")
    store.put("object", key, content)
    if turn % 20 == int(sys.argv[2]):
        store.clear()
"""


def test_many_processes_read_and_write_at_once(tmp_path: Path) -> None:
    workers = [
        subprocess.Popen([sys.executable, "-c", WORKER, str(tmp_path), str(number)], stderr=subprocess.PIPE)
        for number in range(8)
    ]
    for worker in workers:
        _, message = worker.communicate()
        assert worker.returncode == 0, message.decode()
    store = Store(directory=tmp_path, limit=60_000)
    assert sum(entry.size for entry in store.entries()) <= 60_000
    assert not list(tmp_path.glob("*/*.part"))
    for entry in store.entries():
        assert store.get("object", entry.path.stem) == entry.path.stem.encode() * 100
