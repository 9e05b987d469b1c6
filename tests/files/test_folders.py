"""Folders that are written: all files or none, nothing lost that somebody else put there, no links followed."""

from __future__ import annotations

import subprocess
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from mbm.files import folders
from mbm.files.folders import check_folder, write_folder, write_new_folder
from mbm.files.journal import THE_PROBLEM, Journal, Read, note, noting
from mbm.files.names import LARGEST, Maker, Names, file_name, folded, is_plain
from mbm.text.types import MbmError

MAKER = Maker(command="mbm make", manifest=".made")
FILES = [("a.txt", b"one"), ("sub/b.txt", b"two"), ("sub/deep/c.txt", b"three")]


def write(folder: Path, files: Any = FILES, **options: Any) -> None:
    write_folder(folder, files, MAKER, force=options.pop("force", False), **options)


def refused(folder: Path, files: Any = FILES, **options: Any) -> str:
    """What is said where writing is refused, with the codes; nothing changes."""
    before = content(folder)
    with pytest.raises(MbmError) as caught:
        write(folder, files, **options)
    assert content(folder) == before
    return "\n".join(f"{d.code.name}: {d.message}" for d in caught.value.diagnostics)


def content(folder: Path) -> dict[str, object]:
    """All there is in a folder and beside it: what files hold, where links lead."""
    return {
        str(path.relative_to(folder.parent)): path.readlink() if path.is_symlink() else path.read_bytes()
        for path in sorted(folder.parent.rglob("*"))
        if path.is_symlink() or path.is_file()
    } | {f"{path}/": None for path in folder.parent.rglob("*") if path.is_dir()}


def reads_of(*paths: Path, role: str | None = None) -> tuple[Read, ...]:
    journal = Journal()
    with noting(journal):
        for path in paths:
            note(path, role)
    return journal.reads()


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


def test_a_new_folder_with_a_list_that_programs_can_check(out: Path) -> None:
    write(out)
    assert {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()} == {
        **dict(FILES),
        ".made": (out / ".made").read_bytes(),
    }
    lines = (out / ".made").read_text().splitlines()
    assert lines[1:] == [f"{sha256(text).hexdigest()}  {name}" for name, text in FILES]
    checked = subprocess.run(["sha256sum", "--check", "--strict", ".made"], cwd=out, capture_output=True, check=False)
    assert checked.returncode == 0, checked.stderr


def test_folders_on_the_way_are_made_and_an_empty_one_is_filled(tmp_path: Path) -> None:
    write(tmp_path / "x" / "y" / "out")
    (tmp_path / "empty").mkdir(mode=0o700)
    write(tmp_path / "empty")
    assert (tmp_path / "empty" / "sub" / "b.txt").read_bytes() == b"two"
    assert (tmp_path / "empty").stat().st_mode & 0o777 == 0o700
    assert {path.name for path in tmp_path.iterdir()} == {"x", "empty"}


def test_what_was_written_may_be_written_again_and_what_is_not_made_any_more_goes(out: Path) -> None:
    write(out)
    (out / "build.o").write_bytes(b"somebody's")
    (out / "sub" / "notes").write_bytes(b"somebody's")
    write(out, [("a.txt", b"new"), ("d.txt", b"four")])
    assert {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()} == {
        "a.txt": b"new",
        "d.txt": b"four",
        "build.o": b"somebody's",
        "sub/notes": b"somebody's",
        ".made": (out / ".made").read_bytes(),
    }
    assert not (out / "sub" / "deep").exists()


def test_what_was_changed_since_is_neither_replaced_nor_removed(out: Path) -> None:
    write(out)
    (out / "a.txt").write_bytes(b"changed")
    (out / "sub" / "b.txt").write_bytes(b"changed too")
    said = refused(out)
    assert said.count("would-overwrite: ") == 2
    assert f"`{out}/a.txt` was changed since `mbm make` wrote it" in said
    write(out, [("sub/deep/c.txt", b"three")])
    assert (out / "a.txt").read_bytes() == b"changed"
    assert (out / "sub" / "b.txt").read_bytes() == b"changed too"
    write(out, force=True)
    assert (out / "a.txt").read_bytes() == b"one"


def test_a_new_name_that_somebody_has(out: Path) -> None:
    write(out)
    (out / "d.txt").write_bytes(b"somebody's")
    assert f"`{out}/d.txt` was not written by `mbm make`" in refused(out, [*FILES, ("d.txt", b"mine")])
    write(out, [*FILES, ("d.txt", b"mine")], force=True)
    assert (out / "d.txt").read_bytes() == b"mine"


def test_a_folder_with_other_things_is_refused_without_force(out: Path) -> None:
    out.mkdir()
    (out / "thesis.tex").write_bytes(b"years")
    (out / "a.txt").write_bytes(b"mine")
    assert f"foreign-folder: `{out}` holds files that `mbm make` did not write, such as `a.txt`" in refused(out)
    write(out, force=True)
    assert (out / "thesis.tex").read_bytes() == b"years"
    assert (out / "a.txt").read_bytes() == b"one"
    write(out)  # it is known now what is whose
    (out / "thesis.tex").write_bytes(b"more years")
    assert "was not written by" in refused(out, [("thesis.tex", b"")])


@pytest.mark.parametrize(
    "text",
    [
        "a.txt\nsub/b.txt\n",  # as the first version wrote it
        f"{'0' * 64}  ../../x\n",
        f"{'0' * 64}  /etc/passwd\n",
        f"{'0' * 64}  a.txt\nnonsense\n",
        "\udcff",
        "#" * (LARGEST + 1),
    ],
)
def test_a_list_that_says_too_little_counts_for_nothing(text: str, out: Path) -> None:
    out.mkdir()
    (out / "a.txt").write_bytes(b"perhaps changed")
    (out / ".made").write_bytes(text.encode(errors="surrogateescape"))
    assert "does not say which of its files `mbm make` wrote" in refused(out)
    write(out, force=True)
    write(out)


def test_what_a_list_names_is_removed_only_if_it_is_as_listed_and_no_link(out: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "b.txt").write_bytes(b"two")
    write(out)
    (out / "sub" / "b.txt").unlink()
    (out / "sub" / "deep" / "c.txt").unlink()
    (out / "sub" / "deep").rmdir()
    (out / "sub").rmdir()
    (out / "sub").symlink_to(other)
    write(out, [("a.txt", b"one")])
    assert (other / "b.txt").read_bytes() == b"two"


@pytest.mark.parametrize("force", [False, True])
def test_links_are_never_followed(force: bool, tmp_path: Path) -> None:
    real = tmp_path / "real"
    real.mkdir()
    for name in ("a.txt", "b.txt", ".made"):
        (real / name).write_bytes(b"measured")
    (tmp_path / "link").symlink_to(real)
    assert "`" + str(tmp_path / "link") + "` cannot be written: it is a symbolic link" in refused(
        tmp_path / "link", force=force
    )
    (tmp_path / "nowhere").symlink_to(tmp_path / "new")
    assert "it is a symbolic link" in refused(tmp_path / "nowhere", force=force)
    for number, link in enumerate(("a.txt", "sub", "sub/b.txt", ".made", "sub/deep")):
        out = tmp_path / f"out{number}"
        write(out)
        place = out / link
        if place.is_dir():
            place.rename(tmp_path / f"away{number}")
        else:
            place.unlink()
        place.symlink_to(real if "." not in link else real / link.split("/")[-1])
        said = refused(out, force=force)
        assert "it is a symbolic link" in said or (link == ".made" and "foreign-folder" in said and not force)


@pytest.mark.parametrize("force", [False, True])
def test_never_over_what_is_read_nor_into_the_folder_of_the_problem(force: bool, out: Path, tmp_path: Path) -> None:
    write(out)
    assert "would-overwrite" in refused(out, force=force, reads=reads_of(out / "sub" / "b.txt"))
    write(out, [("a.txt", b"one")], force=force, reads=reads_of(out / "sub" / "b.txt"))
    assert (out / "sub" / "b.txt").exists(), "what is no longer made may be read"
    problem = out / "p.mbm"
    problem.write_bytes(b"")
    (tmp_path / "q.mbm").symlink_to(problem)
    for path in (problem, tmp_path / "q.mbm"):
        said = refused(out, [("a.txt", b"one")], force=force, reads=reads_of(path, role=THE_PROBLEM))
        assert "it holds the problem" in said


@pytest.mark.parametrize(
    "path",
    ["../a", "a/../../b", "/etc/x", "", ".", "a//b", "./a", "a/", "a\nb", "a\0b", "\udcff", "C:x", "a\\b", "\u202ea"],
)
def test_names_that_lead_elsewhere_are_refused_whoever_made_them(path: str, out: Path) -> None:
    assert "no file below a folder is called so" in refused(out, [("a.txt", b""), (path, b"")])
    assert "no file below a folder is called so" in refused(out, [(path, b"")], force=True)


@pytest.mark.parametrize(
    "pair",
    [("a", "a"), ("a", "A"), ("é", "e\u0301"), ("straße", "STRASSE"), ("a", "a/b"), ("a/b", "A"), (".MADE", "x")],
)
def test_two_files_of_one_name_are_refused(pair: tuple[str, str], out: Path) -> None:
    assert "two files would have this name" in refused(out, [(name, b"") for name in pair], force=True)


def test_what_stands_in_the_way(out: Path, tmp_path: Path) -> None:
    out.write_bytes(b"a file")
    assert "it is no folder" in refused(out, force=True)
    assert "Not a directory" in refused(out / "below", force=True)
    other = tmp_path / "other"
    (other / "a.txt").mkdir(parents=True)
    (other / "sub").write_bytes(b"")
    said = refused(other, force=True)
    assert "a.txt` cannot be written: it is no ordinary file" in said
    assert "sub` cannot be written: it is no folder" in said
    assert "no folder can have this name" in refused(tmp_path / "a\0b")
    assert "not-writable" in refused(tmp_path / ("a" * 300))


def test_a_path_out_of_a_folder_that_is_not_there_leads_nowhere(tmp_path: Path) -> None:
    for path in ("none/../out", "a/none/../b"):
        assert "No such file or directory" in refused(tmp_path / path, force=True)
        with pytest.raises(MbmError, match="No such file or directory"):
            check_folder(tmp_path / path, MAKER, force=True)
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_read_only(out: Path) -> None:
    write(out)
    (out / "a.txt").chmod(0o444)
    assert "it is read-only" in refused(out, force=True)


@pytest.mark.parametrize("exists", [False, True])
@pytest.mark.parametrize("fault", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("calls", [1, 3])
def test_a_failure_half_way_leaves_nothing(
    exists: bool, fault: BaseException, calls: int, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if exists:
        write(out)
    before = content(out)
    stage, count = folders.stage, []

    def staged(*given: Any) -> Path:
        count.append(1)
        if len(count) > calls:
            raise fault
        return stage(*given)

    monkeypatch.setattr(folders, "stage", staged)
    with pytest.raises(MbmError if isinstance(fault, OSError) else KeyboardInterrupt):
        write(out, [("a.txt", b"new"), ("more/b.txt", b"new"), ("sub/b.txt", b"new"), ("x/y/z.txt", b"new")])
    assert content(out) == before


def test_looking_first_touches_nothing(out: Path, tmp_path: Path) -> None:
    check_folder(out, MAKER, force=False)
    assert not list(tmp_path.iterdir())
    out.mkdir()
    (out / "x").touch()
    with pytest.raises(MbmError, match="foreign-folder"):
        check_folder(out, MAKER, force=False)
    check_folder(out, MAKER, force=True)
    with pytest.raises(MbmError, match="it holds the problem"):
        check_folder(out, MAKER, force=True, reads=reads_of(out / "x", role=THE_PROBLEM))


def test_a_new_folder_holds_nothing_before(tmp_path: Path) -> None:
    for name in ("file", "full/x"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "empty").mkdir()
    (tmp_path / "link").symlink_to("empty")
    for name in ("file", "full", "link"):
        with pytest.raises(MbmError, match="exists-already"):
            write_new_folder(tmp_path / name, FILES)
    write_new_folder(tmp_path / "empty", FILES)
    write_new_folder(tmp_path / "new", FILES)
    for name in ("empty", "new"):
        assert {p.relative_to(tmp_path / name).as_posix() for p in (tmp_path / name).rglob("*.txt")} == set(dict(FILES))


@given(st.lists(st.text(), max_size=8))
def test_every_text_gives_a_plain_name_and_all_differ(texts: list[str]) -> None:
    names = Names()
    found = [names.own(file_name(text, ".csv")) for text in texts]
    assert all(is_plain(name) and "/" not in name for name in found)
    assert len({folded(name) for name in found}) == len(found)


@given(st.lists(st.text("abA/", min_size=1, max_size=5).filter(is_plain), max_size=12))
def test_paths_that_are_given_out_can_stand_together(texts: list[str]) -> None:
    names = Names()
    found = [folded(names.own(text)) for text in texts]
    assert len(set(found)) == len(found)
    for path in found:
        assert not any(other.startswith(f"{path}/") for other in found)
