"""What the store trusts: folders and files of this user that nobody else may write to, and nothing that is a link.

Entries hold machine code that is executed. Each test changes one thing that the file system says of one path.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from mbm.kernels import store as stores
from mbm.kernels.store import Doubt, Store, standard_store

KEY, OTHER = "ab" * 32, "cd" * 32
OPEN = [0o720, 0o702, 0o770, 0o777, 0o1777, 0o757]
"""Each bit by which others may write, alone and with others; the sticky bit keeps nobody from adding files."""

FIELDS = ("st_mode", "st_ino", "st_dev", "st_nlink", "st_uid", "st_gid", "st_size", "st_atime", "st_mtime", "st_ctime")
"""What the system says of a path, in its order."""

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="folders of a user's profile are the user's")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(directory=tmp_path / "cache")
    made.put("object", KEY, b"code")
    assert made.get("object", KEY) == b"code"
    return made


def file(store: Store) -> Path:
    return store.directory / "object" / f"{KEY}.entry"


def unused(store: Store) -> None:
    """The store has nothing to give, takes nothing, and leaves what is there alone."""
    before = listing(store)
    assert store.get("object", KEY) is None
    assert store.get("problem", KEY) is None
    store.put("object", OTHER, b"more")
    assert store.entries() == store.clear() == ()
    assert listing(store) == before


def listing(store: Store) -> list[Path]:
    return sorted(store.directory.rglob("*"))


Changed = Callable[[Path, dict[str, int]], None]


@pytest.fixture
def changed(monkeypatch: pytest.MonkeyPatch) -> Changed:
    """Lets the system say something else of a path, looked at by name or when it is open."""
    by_name, when_open = Path.lstat, os.fstat

    def change(path: Path, fields: dict[str, int]) -> None:
        number = by_name(path).st_ino

        def other(found: os.stat_result) -> os.stat_result:
            if found.st_ino != number:
                return found
            return os.stat_result([fields.get(name, getattr(found, name)) for name in FIELDS])

        monkeypatch.setattr(Path, "lstat", lambda self: other(by_name(self)))
        monkeypatch.setattr(os, "fstat", lambda number: other(when_open(number)))

    return change


@pytest.mark.parametrize("mode", OPEN)
def test_a_folder_that_others_may_write_to_is_not_used(mode: int, store: Store) -> None:
    store.directory.chmod(mode)
    assert store.doubts() == ((store.directory, Doubt.OPEN),)
    unused(store)
    store.directory.chmod(0o755)
    assert store.doubts() == ()
    assert store.get("object", KEY) == b"code"


@pytest.mark.parametrize("mode", OPEN)
def test_a_kind_that_others_may_write_to_is_not_used(mode: int, store: Store) -> None:
    (store.directory / "object").chmod(mode)
    assert store.doubts() == ((store.directory / "object", Doubt.OPEN),)
    unused(store)
    store.put("problem", KEY, b"of another kind")
    assert store.get("problem", KEY) == b"of another kind"


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_an_entry_that_others_may_write_to_is_none(mode: int, store: Store) -> None:
    file(store).chmod(mode)
    assert store.get("object", KEY) is None
    assert not file(store).exists()


def test_what_others_may_read_is_used(store: Store) -> None:
    for path, mode in ((store.directory, 0o755), (file(store).parent, 0o755), (file(store), 0o644)):
        path.chmod(mode)
    assert store.get("object", KEY) == b"code"
    assert store.doubts() == ()


def test_what_belongs_to_another_user_is_not_used(store: Store, changed: Changed) -> None:
    changed(store.directory, {"st_uid": os.getuid() + 1})
    assert store.doubts() == ((store.directory, Doubt.ANOTHERS),)
    unused(store)


def test_a_kind_of_another_user_is_not_used(store: Store, changed: Changed) -> None:
    changed(store.directory / "object", {"st_uid": os.getuid() + 1})
    assert store.doubts() == ((store.directory / "object", Doubt.ANOTHERS),)
    unused(store)


def test_an_entry_of_another_user_is_none(store: Store, changed: Changed) -> None:
    changed(file(store), {"st_uid": os.getuid() + 1})
    assert store.get("object", KEY) is None


@pytest.mark.parametrize("name", ["getuid", "geteuid"])
def test_both_the_user_and_whose_rights_the_process_has_must_be_the_owner(
    name: str, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = os.getuid() + 1
    monkeypatch.setattr(os, name, lambda: other)
    unused(store)


def test_an_entry_that_has_a_second_name_is_none(store: Store, tmp_path: Path) -> None:
    """Somebody else's link to a file of this user, or an entry that is written to under another name."""
    os.link(file(store), tmp_path / "second")
    assert store.get("object", KEY) is None
    assert (tmp_path / "second").read_bytes().endswith(b"code")


def test_an_entry_is_an_ordinary_file(store: Store, changed: Changed) -> None:
    changed(file(store), {"st_mode": stat.S_IFCHR | 0o600})
    assert store.get("object", KEY) is None


def test_a_pipe_in_the_place_of_an_entry_is_not_waited_for(store: Store) -> None:
    file(store).unlink()
    os.mkfifo(file(store), 0o600)
    assert store.get("object", KEY) is None
    store.put("object", KEY, b"code")
    assert store.get("object", KEY) == b"code"


def test_an_entry_that_is_larger_than_the_store_is_not_read(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten gigabytes that take no room on the disk."""
    os.truncate(file(store), 10**10)
    assert store.get("object", KEY) is None
    assert not file(store).exists()
    store.put("object", KEY, b"code")
    assert Store(directory=store.directory, limit=16).get("object", KEY) is None


def test_a_link_to_a_folder_is_none(store: Store, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(store.directory)
    linked = Store(directory=tmp_path / "link")
    assert linked.doubts() == ((tmp_path / "link", Doubt.LINK),)
    unused(linked)
    (store.directory / "problem").symlink_to(store.directory / "object")
    assert store.doubts() == ((store.directory / "problem", Doubt.LINK),)
    assert store.get("problem", KEY) is None
    assert [entry.kind for entry in store.clear()] == ["object"]


def test_a_link_that_leads_nowhere_makes_nothing_there(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "target")
    Store(directory=tmp_path / "link").put("object", KEY, b"code")
    assert not (tmp_path / "target").exists()


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    assert Store(directory=tmp_path / "file").doubts() == ((tmp_path / "file", Doubt.NO_FOLDER),)


@pytest.mark.parametrize("umask", [0, 0o022, 0o777])
def test_folders_are_made_for_their_owner_only_whatever_the_umask(umask: int, tmp_path: Path) -> None:
    store = Store(directory=tmp_path / "above" / "between" / "cache")
    before = os.umask(umask)
    try:
        store.put("object", KEY, b"x")
    finally:
        os.umask(before)
    for folder in (store.directory / "object", store.directory, *store.directory.parents[:2]):
        assert folder.stat().st_mode & 0o777 == 0o700


def test_folders_are_never_open_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even between their making and whatever may follow."""
    made: list[int] = []
    make = os.mkdir

    def looked_at(path: str | Path, mode: int = 0o777) -> None:
        make(path, mode)
        made.append(Path(path).stat().st_mode & 0o777)

    before = os.umask(0)
    try:
        monkeypatch.setattr(os, "mkdir", looked_at)
        Store(directory=tmp_path / "above" / "cache").put("object", KEY, b"x")
    finally:
        os.umask(before)
    assert made == [0o700] * 3


def test_the_users_store_is_none_where_the_folder_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MBM_CACHE", str(tmp_path / "cache"))
    assert standard_store() is not None
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    assert standard_store() is None


def test_root_makes_nothing_in_the_home_of_another_user(
    tmp_path: Path, changed: Changed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``sudo mbm`` with the HOME of who called it: that user could not use the folders."""
    monkeypatch.setenv("MBM_CACHE", str(tmp_path / "cache"))
    for name in ("getuid", "geteuid"):
        monkeypatch.setattr(os, name, lambda: 0)
    changed(tmp_path, {"st_uid": 1234})
    store = Store(directory=tmp_path / "cache")
    assert store.doubts() == ((tmp_path / "cache", Doubt.ABOVE),)
    assert standard_store() is None
    store.put("object", KEY, b"x")
    assert not store.directory.exists()


def test_root_uses_a_folder_below_what_is_roots(
    tmp_path: Path, changed: Changed, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("getuid", "geteuid"):
        monkeypatch.setattr(os, name, lambda: 0)
    changed(tmp_path, {"st_uid": 0})
    assert stores.doubt_about(tmp_path / "below" / "cache") is None


def test_other_users_may_have_a_folder_below_anybodys(
    tmp_path: Path, changed: Changed, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("getuid", "geteuid"):
        monkeypatch.setattr(os, name, lambda: 1000)
    changed(tmp_path, {"st_uid": 1234})
    assert stores.doubt_about(tmp_path / "cache") is None


def test_clear_takes_nothing_that_only_looks_like_ours(store: Store) -> None:
    """Downloads of browsers end in ``.part`` too."""
    names = ("film.part", "notes.entry", "a.b.entry", f"{KEY[:-1]}.entry", f"{KEY.upper()}.entry", f"x{KEY}.entry")
    for name in names:
        (store.directory / "object" / name).write_bytes(b"mine")
    os.utime(store.directory / "object" / "film.part", (1.0, 1.0))
    Store(directory=store.directory, limit=1000).put("object", OTHER, b"x")
    assert {entry.path.stem for entry in store.clear()} == {KEY, OTHER}
    assert {path.name for path in (store.directory / "object").iterdir()} == set(names)


@pytest.mark.parametrize("key", ["", "ab", "g" * 64, "AB" * 32, f"{KEY}0", f"../{KEY[3:]}"])
def test_keys_are_digests(key: str, store: Store) -> None:
    with pytest.raises(ValueError):
        store.put("object", key, b"x")
    with pytest.raises(ValueError):
        store.get("object", key)
