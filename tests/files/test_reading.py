"""What is read of the file system: ordinary files of bounded size, UTF-8 where text is wanted."""

import io
import os
import sys
from pathlib import Path

import pytest

from mbm.files import faults
from mbm.files.reading import read_bytes, read_file
from mbm.text.characters import LARGEST_TEXT
from mbm.text.faults import NOT_TEXT, TEXT_TOO_LARGE
from mbm.text.reader import read
from mbm.text.types import DataPlace, MbmError, Source


def file_diagnostic(path):
    with pytest.raises(MbmError) as caught:
        read_file(path, "f.mbm")
    (diagnostic,) = caught.value.diagnostics
    return diagnostic


def test_a_missing_file(tmp_path):
    diagnostic = file_diagnostic(tmp_path / "none.mbm")
    assert diagnostic.code is faults.MISSING_FILE
    assert diagnostic.place == DataPlace(file="f.mbm")


def test_a_directory(tmp_path):
    assert file_diagnostic(tmp_path).code is faults.NOT_A_FILE


def test_a_name_that_no_file_can_have(tmp_path):
    assert file_diagnostic(tmp_path / "a\0b").code is faults.MISSING_FILE
    assert file_diagnostic(tmp_path / ("a" * 5000)).code is faults.UNREADABLE_FILE


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert file_diagnostic(tmp_path / "pipe").code is faults.NOT_A_FILE


def test_a_pipe_that_takes_the_place_of_a_file_in_between_is_refused(tmp_path, monkeypatch):
    (tmp_path / "d").write_bytes(b"text")

    def replaced(*_arguments, **_named):
        (tmp_path / "d").unlink()
        os.mkfifo(tmp_path / "d")

    monkeypatch.setattr("mbm.files.reading.check_ordinary", replaced)
    assert file_diagnostic(tmp_path / "d").code is faults.NOT_A_FILE


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full", "/dev/tty"])
def test_a_device_is_refused(device):
    with pytest.raises(MbmError) as caught:
        read_bytes(Path(device), DataPlace(file="d"), largest=10)
    assert caught.value.diagnostics[0].code is faults.NOT_A_FILE


@pytest.mark.parametrize("size", [LARGEST_TEXT, LARGEST_TEXT + 1])
def test_standard_input_is_bounded(size, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b" " * size)))
    if size == LARGEST_TEXT:
        assert len(read_file(Path("-"), "-").text) == size
    else:
        with pytest.raises(MbmError) as caught:
            read_file(Path("-"), "-")
        assert caught.value.diagnostics[0].code is TEXT_TOO_LARGE


def test_a_file_that_a_file_names_is_no_standard_input(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MbmError) as caught:
        read_file(Path("-"), "-", DataPlace(file="other.mbm"))
    assert caught.value.diagnostics[0].code is faults.MISSING_FILE


def test_what_the_shell_has_opened_is_read_if_the_user_names_it(tmp_path):
    exit_, entrance = os.pipe()
    os.write(entrance, b"(a)")
    os.close(entrance)
    path = Path(f"/dev/fd/{exit_}")
    with pytest.raises(MbmError):
        read_bytes(path, DataPlace(file="d"), largest=10)
    assert read_bytes(path, DataPlace(file="d"), largest=10, streams=True) == b"(a)"
    os.close(exit_)


def test_a_stream_without_end_is_refused_at_the_bound():
    with Path("/dev/zero").open("rb") as zeros, pytest.raises(MbmError) as caught:
        read_bytes(Path(f"/dev/fd/{zeros.fileno()}"), DataPlace(file="d"), largest=1000, streams=True)
    assert caught.value.diagnostics[0].code is faults.FILE_TOO_LARGE


def test_bytes_up_to_the_bound(tmp_path):
    path = tmp_path / "f"
    path.write_bytes(b"x" * 10)
    assert read_bytes(path, DataPlace(file="d"), largest=10) == b"x" * 10
    with pytest.raises(MbmError) as caught:
        read_bytes(path, DataPlace(file="d"), largest=9)
    assert caught.value.diagnostics[0].code is faults.FILE_TOO_LARGE


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "binary.mbm"
    path.write_bytes(b"(a\n b \xff\xfe)")
    diagnostic = file_diagnostic(path)
    assert diagnostic.code is NOT_TEXT
    assert (diagnostic.place.line, diagnostic.place.column) == (2, 4)


def test_a_file_with_nul_characters(tmp_path):
    path = tmp_path / "nul.mbm"
    path.write_bytes(b"(a)\n\0\0")
    assert file_diagnostic(path).code is NOT_TEXT


def test_a_file_beyond_the_limit(tmp_path):
    path = tmp_path / "large.mbm"
    path.write_bytes(b" " * (LARGEST_TEXT + 1))
    assert file_diagnostic(path).code is TEXT_TOO_LARGE


def test_an_error_points_at_the_form_that_asked_for_the_file(tmp_path):
    (form,) = read(Source("main.mbm", '\n(use "x.mbm")'))
    with pytest.raises(MbmError) as caught:
        read_file(tmp_path / "x.mbm", "x.mbm", form.span)
    assert caught.value.diagnostics[0].place == form.span


def test_a_byte_order_mark_and_windows_line_breaks_are_allowed(tmp_path):
    path = tmp_path / "windows.mbm"
    path.write_bytes(b"\xef\xbb\xbf(a\r\n b)\r\n")
    assert read_file(path, "w").text == "(a\n b)\n"
