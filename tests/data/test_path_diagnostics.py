"""Diagnostics of paths: what is found out before a file is read stands where the problem names the file."""

from __future__ import annotations

import gzip
import os

import pytest

from mbm.data.content import read_bytes
from mbm.data.loader import load
from mbm.data.readers import READERS
from mbm.text.types import Span


def path_fault(faults_of, declaration, base, **more):
    options = {"given": {}, "paths": {}, "sandbox": None, "readers": READERS} | more
    (fault,) = faults_of(load, declaration, base=base, **options)
    assert isinstance(fault.place, Span)
    assert fault.place.line == 2
    assert fault.labels == ()
    return fault


def test_missing_file(tmp_path, declare, faults_of):
    (tmp_path / "ranges.csv").write_text("x\n1\n")
    fault = path_fault(faults_of, declare(path="range.csv"), tmp_path)
    assert fault.code.name == "missing-file"
    assert f"`{tmp_path.as_posix()}/range.csv` does not exist" in fault.message
    assert fault.hint == "did you mean `ranges.csv`?"


@pytest.mark.parametrize("path", ["no/such/folder.csv", "file.csv/x.csv"])
def test_missing_folder(tmp_path, declare, faults_of, path):
    (tmp_path / "file.csv").write_text("x\n1\n")
    fault = path_fault(faults_of, declare(path=path), tmp_path)
    assert fault.code.name == "missing-file"
    assert "nor does its folder" in fault.message


def test_a_name_that_no_file_can_have(tmp_path, declare, faults_of):
    assert path_fault(faults_of, declare(path="a\0b.csv"), tmp_path).code.name == "missing-file"
    assert path_fault(faults_of, declare(path="a" * 5000), tmp_path).code.name == "unreadable-file"


@pytest.mark.parametrize("path", ["", ".", "sub"])
def test_a_folder(tmp_path, declare, faults_of, path):
    (tmp_path / "sub").mkdir()
    fault = path_fault(faults_of, declare(path=path), tmp_path)
    assert fault.code.name == "not-a-file"
    assert "is a folder" in fault.message


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_that_would_never_end(tmp_path, declare, faults_of):
    os.mkfifo(tmp_path / "d.csv")
    fault = path_fault(faults_of, declare(), tmp_path)
    assert fault.code.name == "not-a-file"
    assert "a pipe or a device" in fault.message


def test_a_file_that_the_system_refuses(tmp_path, declare, faults_of, monkeypatch):
    (tmp_path / "d.csv").write_text("x\n1\n")

    def refuse(*_arguments, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.open", refuse)  # permissions do not bind the superuser
    (fault,) = faults_of(load, declare(), base=tmp_path, given={}, paths={}, sandbox=None, readers=READERS)
    assert fault.code.name == "unreadable-file"
    assert "cannot be read: Permission denied" in fault.message


def test_a_loop_of_links(tmp_path, declare, faults_of):
    (tmp_path / "d.csv").symlink_to(tmp_path / "d.csv")
    assert path_fault(faults_of, declare(), tmp_path).code.name == "unreadable-file"
    assert path_fault(faults_of, declare(), tmp_path, sandbox=tmp_path).code.name == "unreadable-file"


def test_a_file_too_large(tmp_path, declare, faults_of):
    with (tmp_path / "d.csv").open("wb") as stream:
        stream.truncate(2_000_000_001)  # a hole: no disk is used
    fault = path_fault(faults_of, declare(), tmp_path)
    assert fault.code.name == "file-too-large"
    assert "2,000,000,001 bytes" in fault.message


def test_a_file_that_grows_while_it_is_read(tmp_path, monkeypatch, faults_of):
    path = tmp_path / "d.csv"
    path.write_text("x\n1\n")
    with monkeypatch.context() as looked_at_before:
        looked_at_before.setattr("mbm.files.reading.check_ordinary", lambda *_arguments, **_options: None)
        (fault,) = faults_of(read_bytes, path, largest=3)
    assert fault.code.name == "file-too-large"
    assert read_bytes(path, largest=4)[0] == b"x\n1\n"


def test_a_small_file_that_unpacks_to_fill_the_memory(tmp_path, faults_of):
    path = tmp_path / "d.csv.gz"
    path.write_bytes(gzip.compress(b"1,1\n" * 26_000_000, compresslevel=1))
    (fault,) = faults_of(read_bytes, path)
    assert fault.code.name == "file-too-large"
    assert f"the {path.stat().st_size:,} bytes of" in fault.message


@pytest.mark.parametrize("path", ["../d.csv", "link.csv", "out/d.csv"])
def test_files_outside_the_sandbox(tmp_path, declare, faults_of, path):
    sandbox = tmp_path / "in"
    sandbox.mkdir()
    (tmp_path / "d.csv").write_text("x\n1\n")
    (sandbox / "link.csv").symlink_to(tmp_path / "d.csv")
    (sandbox / "out").symlink_to(tmp_path)
    fault = path_fault(faults_of, declare(path=path), sandbox, sandbox=sandbox)
    assert fault.code.name == "outside-sandbox"
    assert "lies outside" in fault.message


@pytest.mark.parametrize("path", [__file__, "/no/such/file"])
def test_the_sandbox_does_not_tell_what_exists_outside(tmp_path, declare, faults_of, path):
    assert path_fault(faults_of, declare(path=path), tmp_path, sandbox=tmp_path).code.name == "outside-sandbox"
    on_command_line = path_fault(faults_of, declare(), tmp_path, sandbox=tmp_path, paths={"d": path})
    assert on_command_line.code.name == "outside-sandbox"


def test_an_unknown_format(tmp_path, declare, faults_of):
    fault = path_fault(faults_of, declare("external", None), tmp_path, paths={"d": "ranges.xlsx"})
    assert fault.code.name == "unknown-format"
    assert "`ranges.xlsx`" in fault.message
    assert "`.csv`" in fault.message


def test_a_missing_table(tmp_path, declare, faults_of):
    fault = path_fault(faults_of, declare("external", None), tmp_path)
    assert fault.code.name == "missing-table"
    assert "--data d=PATH" in fault.hint
    assert 'data={"d": …}' in fault.hint
