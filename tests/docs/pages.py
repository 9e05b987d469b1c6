"""Runs the examples of a Markdown page, in order, in one folder.

Blocks by the words behind their fence:

* ``LANGUAGE file=NAME`` is written to the folder as NAME.
* ``mbm check`` and ``mbm solve`` are whole files: no diagnostics, and exit status 0.
* ``mbm error=CODE`` is a whole file: the first diagnostic has that code.
* ``mbm expand`` holds definitions, then lines ``FORM  ; TEXT``: what the form expands to.
* ``console`` holds command lines of mbm behind ``$``, each with all that it prints.
* ``pycon`` is a session of Python; a page shares one.

A comment ``<!-- files: FOLDER -->`` lays the files of a folder of the project beside them first.

Other blocks (``text``, ``sh``, plain ``mbm``) are shown only.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import re
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mbm
from mbm.cli.main import run

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^```(?P<info>[^\n`]+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
SHOWN_ONLY = {"text", "sh", "json", "markdown"}


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: its language, the words behind it, its text and its line."""

    language: str
    words: tuple[str, ...]
    text: str
    line: int

    def option(self, name: str) -> str | None:
        """The value of ``name=value`` behind the fence."""
        return next((w.partition("=")[2] for w in self.words if w.startswith(f"{name}=")), None)


def blocks(page: str) -> Iterator[Block]:
    """The fenced blocks of a page."""
    for match in FENCE.finditer(page):
        language, *words = match["info"].split()
        yield Block(language, tuple(words), match["text"], page.count("\n", 0, match.start()) + 1)


def play(page: str, folder: Path) -> Iterator[tuple[Block, str, str]]:
    """(block, what it should give, what it gives) of everything that the page claims. Runs in the working directory."""
    for source in re.findall(r"<!-- files: (\S+) -->", page):
        shutil.copytree(ROOT / source, folder, dirs_exist_ok=True)
    session: dict[str, object] = {}
    for number, block in enumerate(blocks(page)):
        file = block.option("file")
        if file is not None:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_text(block.text, encoding="utf-8")
        elif block.language == "console":
            yield block, block.text, console(block.text)
        elif block.language == "pycon":
            yield block, "", session_failures(block.text, session)
        elif block.language == "mbm" and block.words:
            yield block, *claim(block, folder / f"block{number}.mbm")
        elif block.language == "mbm" or block.language not in SHOWN_ONLY:
            yield block, "a block that is run or of a language that is shown only", f"```{block.language}"


def claim(block: Block, path: Path) -> tuple[str, str]:
    """What a block of mbm should give, and what it gives."""
    path.write_text(block.text, encoding="utf-8")
    code = block.option("error")
    if code is not None:
        return code, first_code(path)
    if block.words[0] == "expand":
        return block.text, expanded(block.text, path)
    if block.words[0] == "check":
        return "", command("check", "--quiet", str(path))
    if block.words[0] == "solve":
        output = "".join(solved(path, name) for name in mbm.load(path).names)
        return "", output
    return "a known word behind ```mbm", " ".join(block.words)


def solved(path: Path, name: str) -> str:
    """What a solve says if it does not end well."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        status = run(["solve", str(path), "--problem", name])
    return "" if status == 0 else f"exit status {status}\n{text.getvalue()}"


def first_code(path: Path) -> str:
    """The code of the first error of a file."""
    try:
        found = mbm.api.check(path)
    except mbm.MbmError as error:
        found = error.diagnostics
    return found[0].code.name if found else "no diagnostics"


def expanded(text: str, path: Path) -> str:
    """The block with what each form expands to behind its semicolon."""
    lines = text.splitlines(keepends=True)
    first = next(i for i, line in enumerate(lines) if "  ; " in line)
    path.write_text("".join(lines[:first]) or ";\n", encoding="utf-8")
    found = []
    for line in lines[first:]:
        form, separator, _ = line.partition("  ; ")
        found.append(f"{form}{separator}{command('expand', str(path), form).strip()}\n" if separator else line)
    return "".join([*lines[:first], *found])


def console(text: str) -> str:
    """The session with what its commands print now."""
    lines = [line for line in text.splitlines() if line.startswith("$ ")]
    return "".join(f"{line}\n{command(*words(line))}" for line in lines)


def words(line: str) -> list[str]:
    """The arguments of ``$ mbm …``."""
    program, *arguments = shlex.split(line[2:])
    if program != "mbm":
        message = f"a console block runs mbm only: {line}"
        raise ValueError(message)
    return arguments


def command(*arguments: str) -> str:
    """What a command line prints: standard error, then standard output, without blanks at the ends of lines."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        run(arguments)
    return re.sub(r"[ \t]+$", "", error.getvalue() + out.getvalue(), flags=re.MULTILINE)


def session_failures(text: str, names: dict[str, object]) -> str:
    """What a session of Python prints differently; its names stay for the next block."""
    example = doctest.DocTestParser().get_doctest(text, names, "page", None, 0)
    report = io.StringIO()
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    runner.run(example, out=report.write, clear_globs=False)
    names.update(example.globs)
    return report.getvalue()
