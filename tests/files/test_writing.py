"""Files that are written: whole or not at all, in the place that links lead to, never onto what was read."""

from __future__ import annotations

import os
import resource
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from mbm.files import writing
from mbm.files.journal import THE_PROBLEM, Journal, Read, note, noting
from mbm.files.reading import look_into, read_bytes
from mbm.files.targets import refuse_twice, target_of
from mbm.files.writing import checked_target, write_whole
from mbm.text.types import DataPlace, MbmError

PLACE = DataPlace(file="d")


def refused(code: str, path: object, **options: object) -> str:
    """What is said where writing is refused."""
    with pytest.raises(MbmError) as caught:
        write_whole(path, b"new", **options)  # type: ignore[arg-type]
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == code
    return diagnostic.message


def reads_of(*paths: Path | str, role: str | None = None) -> tuple[Read, ...]:
    journal = Journal()
    with noting(journal):
        for path in paths:
            note(Path(path), role)
    return journal.reads()


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """No file may grow beyond ``size`` bytes, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextmanager
def an_ordinary_user() -> Iterator[Path]:
    """A folder of a user for whom permissions count, as which the test goes on."""
    with TemporaryDirectory() as folder:
        root = os.geteuid() == 0
        if root:
            os.chown(folder, 65534, 65534)
            os.seteuid(65534)
        try:
            yield Path(folder)
        finally:
            Path(folder).chmod(0o700)
            if root:
                os.seteuid(0)


def test_a_new_file_has_the_mode_that_the_umask_leaves(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "a", b"text")
    finally:
        os.umask(before)
    assert (tmp_path / "a").read_bytes() == b"text"
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640
    assert [entry.name for entry in tmp_path.iterdir()] == ["a"]


def test_a_file_that_is_replaced_keeps_its_mode(tmp_path: Path) -> None:
    for mode in (0o600, 0o664, 0o755):
        (tmp_path / "a").write_bytes(b"old and longer")
        (tmp_path / "a").chmod(mode)
        write_whole(tmp_path / "a", b"new")
        assert (tmp_path / "a").read_bytes() == b"new"
        assert (tmp_path / "a").stat().st_mode & 0o777 == mode


@pytest.mark.parametrize(("kept", "mode"), [("all", 0o664), ("group", 0o664), ("none", 0o644)])
def test_nobody_gets_more_where_owner_or_group_cannot_be_kept(
    kept: str, mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mode means something else for another group: it gets what all others have."""
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "a").chmod(0o664)
    wanted = (tmp_path / "a").stat()
    asked = []

    def chown(_path: Path, user: int, group: int) -> None:
        asked.append((user, group))
        if kept == "none" or (kept == "group" and user != -1):
            raise PermissionError

    monkeypatch.setattr(os, "chown", chown)
    write_whole(tmp_path / "a", b"new")
    assert (tmp_path / "a").stat().st_mode & 0o777 == mode
    assert asked == [(wanted.st_uid, wanted.st_gid), (-1, wanted.st_gid)][: 1 if kept == "all" else 2]


def test_what_has_the_earlier_file_open_goes_on_reading_that(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"old")
    with (tmp_path / "a").open("rb") as stream:
        write_whole(tmp_path / "a", b"new")
        assert stream.read() == b"old"


def test_a_full_disk_leaves_the_earlier_file(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"old")
    with largest_file(1000), pytest.raises(MbmError) as caught:
        write_whole(tmp_path / "a", bytes(100_000))
    assert "cannot be written: File too large" in str(caught.value)
    assert (tmp_path / "a").read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("fault", [KeyboardInterrupt(), OSError(5, "Input/output error"), MemoryError()])
@pytest.mark.parametrize("call", ["_synchronise", "_make_alike"])
def test_nothing_is_left_of_a_file_that_did_not_become_whole(
    fault: BaseException, call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise fault

    (tmp_path / "a").write_bytes(b"old")
    monkeypatch.setattr(writing, call, fail)
    with pytest.raises(MbmError if isinstance(fault, OSError) else type(fault)):
        write_whole(tmp_path / "a", b"new")
    assert (tmp_path / "a").read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a"]


def test_a_folder_that_is_read_only_and_one_that_is_not_there(tmp_path: Path) -> None:
    with an_ordinary_user() as folder:
        (folder / "a").write_bytes(b"old")
        folder.chmod(0o555)
        assert "which is read-only" in refused("not-writable", folder / "a")
        assert "which is read-only" in refused("not-writable", folder / "new")
        assert (folder / "a").read_bytes() == b"old"
    assert "its folder does not exist" in refused("not-writable", tmp_path / "none" / "a")
    (tmp_path / "file").touch()
    assert "its folder does not exist" in refused("not-writable", tmp_path / "file" / "a")


def test_a_file_that_is_read_only_is_not_replaced_even_by_those_who_may_do_all(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "a").chmod(0o444)
    assert "it is read-only" in refused("not-writable", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == b"old"


def test_what_is_no_place_for_a_file(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for path, reason in (
        (tmp_path, "it is a folder"),
        (f"{tmp_path}/new/", "it names a folder"),
        ("", "its name is empty"),
        (f"{tmp_path}/a\0b", "no file can have this name"),
        (f"{tmp_path}/\ud800", "no file can have this name"),
        (f"{tmp_path}/{'a' * 300}", "File name too long"),
        (tmp_path / "loop", "Too many levels of symbolic links"),
    ):
        assert reason in refused("not-writable", path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["loop"]


def test_odd_names_are_names(tmp_path: Path) -> None:
    for name in ("a\nb", "\udcff", "a" * 255, "-", "…"):
        write_whole(tmp_path / name, b"1")
        write_whole(tmp_path / name, b"2")
        assert (tmp_path / name).read_bytes() == b"2"


def test_links_stay_and_what_they_lead_to_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "real").write_bytes(b"old")
    (tmp_path / "far").symlink_to("sub/real")
    (tmp_path / "link").symlink_to("far")
    (tmp_path / "dangling").symlink_to("sub/new")
    write_whole(tmp_path / "link", b"new")
    write_whole(tmp_path / "dangling", b"made")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "far").is_symlink()
    assert not (tmp_path / "sub" / "real").is_symlink()
    assert {path.name: path.read_bytes() for path in (tmp_path / "sub").iterdir()} == {"real": b"new", "new": b"made"}


def test_another_name_of_the_same_file_keeps_what_it_had(tmp_path: Path) -> None:
    """A hard link, as backups are made of: the file that is written becomes one of its own."""
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "backup").hardlink_to(tmp_path / "a")
    write_whole(tmp_path / "a", b"new")
    assert (tmp_path / "backup").read_bytes() == b"old"


def test_never_onto_a_file_that_was_read_by_whatever_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    data = tmp_path / "d.csv"
    data.write_bytes(b"measured")
    (tmp_path / "link.csv").symlink_to("d.csv")
    (tmp_path / "hard.csv").hardlink_to(data)
    (tmp_path / "folder").symlink_to(tmp_path)
    names = ["d.csv", "./d.csv", str(data), "sub/../d.csv", "link.csv", "hard.csv", "folder/d.csv"]
    for read in names:
        reads = reads_of(read)
        for name in names:
            said = refused("would-overwrite", name, reads=reads)
            assert "a file that the problem reads" in said
            assert f"`{name.removeprefix('./')}`" in said or f"`{name}`" in said
    assert data.read_bytes() == b"measured"
    write_whole("other.csv", b"new", reads=reads_of("d.csv", "missing.csv"))


@pytest.mark.parametrize("missing", ["none/..", "d.csv/..", "none/../none/..", "to-none", "sub/../none/.."])
def test_a_path_out_of_a_folder_that_is_not_there_leads_nowhere(
    missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the system has it; shortened, it would be a file that was read."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    (tmp_path / "d.csv").write_bytes(b"measured")
    (tmp_path / "to-none").symlink_to("none/..")
    (tmp_path / "link").symlink_to(f"{missing}/d.csv")
    with pytest.raises((FileNotFoundError, NotADirectoryError)):
        Path(f"{missing}/d.csv").stat()
    for name in (f"{missing}/d.csv", f"{tmp_path}/{missing}/d.csv", "link"):
        assert "its folder does not exist" in refused("not-writable", name, reads=reads_of("d.csv"))
    assert (tmp_path / "d.csv").read_bytes() == b"measured"


def test_a_journal_holds_what_is_read_while_it_is_kept(tmp_path: Path) -> None:
    for name in ("a", "b", "c", "e"):
        (tmp_path / name).write_bytes(b"x")
    outer, inner = Journal(), Journal()
    read_bytes(tmp_path / "a", PLACE, largest=9)
    with noting(outer):
        read_bytes(tmp_path / "b", PLACE, largest=9)
        with noting(inner):
            read_bytes(tmp_path / "c", PLACE, largest=9)
            look_into(tmp_path / "e", PLACE, largest=9)
    assert [Path(read.path).name for read in outer.reads()] == ["b", "c"]
    assert [Path(read.path).name for read in inner.reads()] == ["c"]
    note(tmp_path / "d")
    assert len(outer.reads()) == 2
    assert len(inner.reads()) == 1


def test_a_file_may_have_been_read_for_what_is_allowed_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    path.write_bytes(b"old")
    start = reads_of(path, role="the start")
    write_whole(path, b"new", reads=start, allowed=("the start",))
    assert path.read_bytes() == b"new"
    journal = Journal()
    with noting(journal):
        note(path, "the start")
        note(path, "the file that table `d` reads")
    assert "table `d`" in refused("would-overwrite", path, reads=journal.reads(), allowed=("the start",))
    assert "that the problem reads" in refused("would-overwrite", path, reads=reads_of(path), allowed=("the start",))


def test_no_result_replaces_a_problem_file(tmp_path: Path) -> None:
    for name in ("p.mbm", "q.MBM"):
        (tmp_path / name).write_bytes(b"(problem)")
        assert "is a problem file" in refused("would-overwrite", tmp_path / name)
    (tmp_path / "r.json").symlink_to("p.mbm")
    assert "is a problem file" in refused("would-overwrite", tmp_path / "r.json")
    write_whole(tmp_path / "r.json", b"laid out", replaces_source=True)
    assert (tmp_path / "p.mbm").read_bytes() == b"laid out"
    write_whole(tmp_path / "new.mbm", b"new")
    with (tmp_path / "p.mbm").open("r+b") as stream:
        assert "is a problem file" in refused("would-overwrite", f"/dev/fd/{stream.fileno()}")


def test_two_targets_that_are_one_file(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    (tmp_path / "b").hardlink_to(tmp_path / "a")
    (tmp_path / "link").symlink_to("new")
    for first, second in (("a", "b"), ("new", "new"), ("new", "link")):
        with pytest.raises(MbmError, match="two outputs go to one file"):
            refuse_twice([target_of(tmp_path / first), target_of(tmp_path / second)])
    refuse_twice([target_of("/dev/null"), target_of("/dev/null"), target_of(tmp_path / "a"), target_of(tmp_path / "n")])


def test_nothing_is_touched_when_a_target_is_looked_at(tmp_path: Path) -> None:
    checked_target(tmp_path / "new")
    assert not list(tmp_path.iterdir())


def test_devices_are_written_directly() -> None:
    write_whole("/dev/null", b"anything")
    assert "No space left" in refused("not-writable", "/dev/full")
    assert Path("/dev/null").is_char_device()


def test_a_pipe_with_a_reader(tmp_path: Path) -> None:
    content = b"0123456789" * 100_000  # more than a pipe holds
    path, found = tmp_path / "pipe", []
    os.mkfifo(path)
    reader = threading.Thread(target=lambda: found.append(path.read_bytes()))
    reader.start()
    write_whole(path, content)
    reader.join()
    assert found == [content]
    assert path.is_fifo()


def test_a_pipe_whose_reader_goes_away_has_taken_what_was_wanted(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)

    taken = []

    def read_a_little() -> None:
        with path.open("rb", buffering=0) as stream:
            taken.append(stream.read(10))

    reader = threading.Thread(target=read_a_little)
    reader.start()
    write_whole(path, bytes(1_000_000))
    reader.join()
    assert taken == [bytes(10)]


def test_a_pipe_that_nobody_reads_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writing, "PATIENCE", 0.05)
    os.mkfifo(tmp_path / "pipe")
    assert "nobody reads from this pipe" in refused("not-writable", tmp_path / "pipe")


def test_a_socket_in_the_file_system_is_no_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        refused("not-writable", "socket")


@pytest.mark.parametrize("folder", ["/dev/fd", "/proc/self/fd", "/proc/thread-self/fd"])
def test_a_stream_that_is_open_is_written_where_it_stands(folder: str, tmp_path: Path) -> None:
    if not Path(folder).is_dir():
        pytest.skip("no such folder on this system")
    (tmp_path / "a").write_bytes(b"before ")
    (tmp_path / "link").symlink_to(folder)
    with (tmp_path / "a").open("ab", buffering=0) as stream:
        write_whole(f"{folder}/{stream.fileno()}", b"one ")
        write_whole(tmp_path / "link" / str(stream.fileno()), b"two")
        assert "reads" in refused("would-overwrite", f"{folder}/{stream.fileno()}", reads=reads_of(tmp_path / "a"))
    assert (tmp_path / "a").read_bytes() == b"before one two"


def test_a_stream_that_is_not_open_or_not_for_writing(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"old")
    with (tmp_path / "a").open("rb") as stream:
        number = stream.fileno()
        refused("not-writable", f"/dev/fd/{number}")
    assert "no file" in refused("not-writable", f"/dev/fd/{10**30}")
    assert "Bad file descriptor" in refused("not-writable", f"/dev/fd/{number}")
    assert (tmp_path / "a").read_bytes() == b"old"


def test_streams_of_other_processes_are_not_ours(tmp_path: Path) -> None:
    """The same number means another file there: nothing may be written to ours instead."""
    with (tmp_path / "a").open("wb") as stream, pytest.raises(MbmError, match="not-writable"):
        write_whole(f"/proc/{os.getppid() + 1_000_000_000}/fd/{stream.fileno()}", b"text")
    assert (tmp_path / "a").read_bytes() == b""


def test_what_was_read_is_named_in_the_message(tmp_path: Path) -> None:
    (tmp_path / "p").touch()
    said = refused("would-overwrite", tmp_path / "p", reads=reads_of(tmp_path / "p", role=THE_PROBLEM))
    assert said == f"`{tmp_path / 'p'}` is the problem itself: it would be lost; nothing was written there"


@pytest.mark.parametrize("number", [1, 2])
def test_a_file_that_standard_output_or_error_goes_to_is_no_target(number: int, tmp_path: Path) -> None:
    before = os.dup(number)
    try:
        with (tmp_path / "said").open("wb") as stream:
            os.dup2(stream.fileno(), number)
        with pytest.raises(MbmError, match="would-overwrite"):
            checked_target(tmp_path / "said")
    finally:
        os.dup2(before, number)
        os.close(before)
    assert checked_target(tmp_path / "said").is_ordinary
