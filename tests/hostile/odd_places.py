"""Pipes, devices, sockets, links and folders in the places of files; very many files, and folders very deep."""

from __future__ import annotations

import os
import socket
from pathlib import Path

from tests.hostile.data_files import SOURCES, problem
from tests.hostile.sizes import size
from tests.trials.choices import Choices
from tests.trials.kinds import Case, Home

PATTERNS = ["**/*.csv", "*/" * 20 + "t.csv", "**/" * 8 + "t.csv", "d/../" * 500 + "d/**/t.csv"]
NUMPY = ("--backend", "numpy")
SOUND = "(problem p (data d (table (y) (1) (2))) (unknowns (a :init 1)) (observe d (= y a) :sigma 1))"
TARGETS = [
    "/dev/zero",
    "/dev/urandom",
    "/dev/null",
    "/dev/full",
    "/dev/tty",
    "/dev/stdin",
    "/dev/fd/0",
    "/dev/fd/1",
    "/proc/self/mem",
    "/proc/self/environ",
    "/proc/self/fd/0",
    "/proc/kmsg",
    "/dev",
    "/",
    "missing",
    "odd",
]
"""What a link leads to; ``odd`` is the link itself."""


def _odd(place: Path, choices: Choices) -> None:
    """Puts there what is no ordinary file."""
    match choices.below(6):
        case 0 | 1:
            os.mkfifo(place)
        case 2:
            place.mkdir()
        case 3:
            listening, here = socket.socket(socket.AF_UNIX), Path.cwd()
            os.chdir(place.parent)  # the path of a socket may have a hundred characters
            try:
                listening.bind(place.name)
            finally:
                os.chdir(here)
                listening.close()
        case _:
            place.symlink_to(choices.one_of(TARGETS))


def odd_place(here: Home, choices: Choices) -> Case:
    """A command that is to read, or write, what is no file."""
    folder = here.cleared("case")
    file, odd = folder / "p.mbm", folder / "odd"
    if choices.chance(5):
        return _many(folder, file, choices)
    _odd(odd, choices)
    file.write_text(SOUND, encoding="utf-8")
    name = choices.one_of((str(odd), "odd", "./odd"))
    if choices.chance(3):
        name = choices.one_of([target for target in TARGETS if target.startswith("/dev")])
    match choices.below(6):
        case 0:
            file.write_text(f'(use "{name}") {SOUND}', encoding="utf-8")
            arguments: tuple[str, ...] = (choices.one_of(("check", "explain", "fmt")), "p.mbm")
        case 1:
            kind = choices.one_of(tuple(SOURCES))
            file.write_text(problem(kind).replace(f'"d.{kind}"', f'"{name}"'), encoding="utf-8")
            arguments = ("check", "p.mbm")
        case 2:
            option = choices.one_of((("--init", name), ("--data", f"d={name}"), ("--sandbox", name)))
            arguments = ("solve", "p.mbm", *NUMPY, *option)
        case 3:
            arguments = choices.one_of((("check", name), ("solve", name), ("fmt", name), ("expand", name, "1")))
        case 4:
            arguments = choices.one_of(
                (("simulate", "p.mbm", "--at", name, "-o", "made"), ("simulate", "p.mbm", "-o", name),
                 ("compile", "p.mbm", "--target", "c", "-o", name))
            )  # fmt: skip
        case _:
            output = choices.one_of(("--json", "--csv", "--residuals", "--plot"))
            # With nobody to read a pipe, writing to it waits for a reader: that is what was asked for.
            place = "out/odd" if odd.is_fifo() else name
            arguments = ("solve", "p.mbm", *NUMPY, output, place)
    return Case(arguments=arguments, files=(file,), kept=() if arguments[0] == "fmt" else (file,))


def _many(folder: Path, file: Path, choices: Choices) -> Case:
    """Files that use one another, a pattern that finds many, folders one in the other."""
    count = size(choices, 10, 3000)
    match choices.below(4):
        case 0:
            for i in range(count):
                (folder / f"u{i}.mbm").write_text(f'(use "u{i + 1}.mbm") (defconst c{i} {i})', encoding="utf-8")
            (folder / f"u{count}.mbm").write_text("(defconst c 1)", encoding="utf-8")
            file.write_text(f'(use "u0.mbm") {SOUND}', encoding="utf-8")
        case 1:
            uses = " ".join(f'(use "u{i}.mbm")' for i in range(count))
            for i in range(count):
                (folder / f"u{i}.mbm").write_text(f"{uses} (defconst c{i} {i})", encoding="utf-8")
                if i > 30:
                    break
            file.write_text(f"{uses} {SOUND}", encoding="utf-8")
        case 2:
            for i in range(count):
                (folder / f"t{i}.csv").write_text("y\n1\n2\n", encoding="utf-8")
            file.write_text(SOUND.replace("(table (y) (1) (2))", '(csv "t*.csv")'), encoding="utf-8")
        case _:
            deep = folder / "/".join(["d"] * min(count, 300))
            deep.mkdir(parents=True)
            (deep / "t.csv").write_text("y\n1\n2\n", encoding="utf-8")
            (deep / "up").symlink_to(folder)
            pattern = choices.one_of(PATTERNS)
            file.write_text(SOUND.replace("(table (y) (1) (2))", f'(csv "{pattern}")'), encoding="utf-8")
    command = choices.one_of((("check", "p.mbm"), ("solve", "p.mbm", *NUMPY, "--json", "-")))
    return Case(arguments=command, files=(file,), kept=(file,))
