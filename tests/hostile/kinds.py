"""The kinds of hostile cases: texts, data files, options, destinations, and problems that are confined to a folder."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from tests.fuzz.kinds import NODES, READINGS, SMALL, write_tables
from tests.fuzz.options import option_lists
from tests.hostile.data_files import PACKERS, SOURCES, hostile_content, problem
from tests.hostile.texts import hostile_text, word
from tests.trials.choices import Choices
from tests.trials.kinds import Case, Home, Kind

SOUND = SMALL.replace("(problem small", '(use "models.mbm")\n(problem small')
MODELS = '(defun twice (n) "twice" (* 2 n))\n(gate (w) (post (trans (w 0 0) (box 1 1 1))))\n'
NUMPY = ("--backend", "numpy")


def home(folder: Path) -> Home:
    """An empty folder, beside a file that nobody may touch."""
    return Home(folder=folder)


def _place(here: Home) -> Path:
    folder = here.cleared("case")
    write_tables(folder)
    (folder / "models.mbm").write_text(MODELS, encoding="utf-8")
    return folder


def _texts(here: Home, choices: Choices) -> Case:
    folder = _place(here)
    file = folder / "hostile.mbm"
    file.write_bytes(hostile_text(choices, SOUND))
    kept = (folder / "nodes.csv", folder / "readings.csv", folder / "models.mbm")
    match choices.below(16):
        case 0 | 1:
            return Case(arguments=("fmt", str(file)), files=(file,), kept=kept)
        case 2:
            return Case(arguments=("fmt", "--check", str(file)), files=(file,), kept=(*kept, file))
        case 3:
            form = word(choices).replace("\x00", "0")
            return Case(arguments=("expand", str(file), "--", form), files=(file,), kept=(*kept, file))
        case 4:
            stage = choices.one_of(("--stage=forms", "--stage=problem", "--stage=symbolic", "--latex", "-v"))
            return Case(arguments=("explain", str(file), stage), files=(file,), kept=(*kept, file))
        case 5:
            return Case(arguments=("solve", str(file), *NUMPY, "-v"), files=(file,), kept=(*kept, file))
        case 6:
            made = ("-o", str(folder / "made"))
            command = ("simulate",) if choices.chance(2) else ("compile", "--target", "python")
            return Case(arguments=(*command, str(file), *made), files=(file,), kept=(*kept, file))
        case _:
            screen = ("--json", "-") if choices.chance(2) else ()
            return Case(arguments=("check", str(file), *screen), files=(file,), kept=(*kept, file))


def _data(kind: str, here: Home, choices: Choices) -> Case:
    folder = _place(here)
    ending = choices.one_of(("", "", "", "", "", "", ".gz", ".bz2", ".xz"))
    table, file = folder / f"d.{kind}{ending}", folder / "p.mbm"
    content = hostile_content(kind, choices)
    if ending:
        content = PACKERS[ending](content)
        content = content[: choices.below(len(content) + 1)] if choices.chance(4) else content
    table.write_bytes(content)
    file.write_text(problem(kind, ending), encoding="utf-8")
    command = ("solve", *NUMPY) if choices.chance(4) else ("check",)
    screen = ("--json", "-") if choices.chance(2) else ()
    return Case(arguments=(*command, str(file), *screen), files=(file, table), kept=(file, table))


def _options(here: Home, choices: Choices) -> Case:
    folder = _place(here)
    file = folder / "small.mbm"
    file.write_text(SOUND, encoding="utf-8")
    arguments, files = option_lists(folder, choices)
    if choices.chance(2):
        option = choices.one_of(
            ("--set", "--data", "--problem", "--method", "--seed", "--noise", "--sandbox", "--init")
        )
        value = choices.one_of((word(choices), f"a={word(choices)}", f"readings={word(choices)}", f"{word(choices)}=1"))
        arguments += [option, value[:4000]]
    arguments = [argument.replace("\x00", "0") for argument in arguments]  # no command line holds a NUL
    kept = (file, folder / "readings.csv", folder / "nodes.csv", folder / "models.mbm", *files)
    return Case(arguments=(*arguments, str(file)), files=(file, *files), kept=kept)


NAMES = [
    "p.mbm",
    "readings.csv",
    "link.csv",
    "link.mbm",
    "models.mbm",
    "full",
    "full/notes.txt",
    "r.json",
    "new.csv",
    "missing/new",
]
NAMES += [
    "/dev/null",
    "/dev/full",
    "-",
    "",
    ".",
    "..",
    "\x1b[2J.csv",
    "a\nb.csv",
    "\u202e.csv",
    "x" * 300,
    "p.mbm/x",
    "hard.csv",
]
NAMES += ["full/../readings.csv", "./p.mbm", "loop", "init.json", "case.link/readings.csv"]


def _destinations(here: Home, choices: Choices) -> Case:
    """Results named onto whatever lies there: the problem, its data, links to them, other people's files."""
    folder = _place(here)
    file, notes, values = folder / "p.mbm", folder / "full" / "notes.txt", folder / "init.json"
    file.write_text(SOUND, encoding="utf-8")
    notes.parent.mkdir()
    notes.write_text("mine", encoding="utf-8")
    values.write_text('{"a": 2}', encoding="utf-8")
    (folder / "r.json").write_text("{}", encoding="utf-8")
    (folder / "link.csv").symlink_to("readings.csv")
    (folder / "link.mbm").symlink_to(file)
    (folder / "case.link").symlink_to(folder)
    (folder / "loop").symlink_to("loop")
    os.link(folder / "readings.csv", folder / "hard.csv")
    arguments: list[str] = []
    options = ["--json", "--csv", "--residuals"]
    for _ in range(choices.count(1, 3)):  # each once: of several the last one counts
        name = choices.one_of(NAMES)
        path = name if name.startswith("/") or name in ("-", "") else str(folder / name)
        option = choices.one_of(options)
        options.remove(option)
        if path == "-" and (option != "--json" or arguments):  # elsewhere a file of this name
            path = str(folder / "-")
        arguments += [option, path]
    command = choices.one_of(("solve", "solve", "check", "simulate", "compile", "fmt"))
    kept = [file, notes, folder / "readings.csv", folder / "nodes.csv", folder / "models.mbm"]
    if command == "solve":
        if str(notes) in arguments:  # results replace what is named for them, unless it is read
            kept.remove(notes)
        arguments += [*NUMPY, *(("--init", str(values)) if choices.chance(3) else ())]
    elif command in ("simulate", "compile"):
        place = {"-": str(folder / "-"), "": ".", "/dev/null": str(folder / "made")}.get(arguments[1], arguments[1])
        arguments = ["-o", place]
        arguments += ["--target", "python"] if command == "compile" else []
    elif command == "fmt":
        kept.remove(file)
        return Case(arguments=("fmt", arguments[1], str(file)), files=(file,), kept=tuple(kept))
    if "init.json" not in " ".join(arguments[: arguments.index("--init")] if "--init" in arguments else arguments):
        kept.append(values)
    return Case(arguments=(command, *arguments, str(file)), files=(file,), kept=tuple(kept))


REACHES = [
    '(data readings (csv "{}"))',
    '(data readings (json "{}"))',
    '(use "{}")',
    '(data readings (csv "{}")) (data readings2 (csv "{}"))',
    '(data n (g2o "{}" :vertices))',
]
WAYS = [
    "../secret.csv",
    "../../case/secret.csv",
    "box/../../secret.csv",
    "link.csv",
    "folder/secret.csv",
    "{secret}",
    "../secr*.csv",
]


def _confined(here: Home, choices: Choices) -> Case:
    """A problem in a folder that it is confined to, which tries to read a file outside."""
    folder = _place(here)
    box, secret = folder / "box", folder / "secret.csv"
    box.mkdir()
    secret.write_text(READINGS, encoding="utf-8")
    (box / "nodes.csv").write_text(NODES, encoding="utf-8")
    (box / "link.csv").symlink_to(secret)
    (box / "folder").symlink_to(folder)
    way = choices.one_of(WAYS).replace("{secret}", str(secret))
    reach = choices.one_of(REACHES).replace("{}", way)
    file = box / "p.mbm"
    inside = f"(problem p {reach} (unknowns (a)) (observe readings (= y a) :sigma 1))"
    file.write_text(f"{reach}\n(problem p (unknowns (a)))" if "use" in reach else inside, encoding="utf-8")
    command = choices.one_of((("check",), ("solve", *NUMPY), ("explain",), ("simulate", "-o", str(folder / "made"))))
    arguments = (*command, str(file), "--sandbox", str(box))
    return Case(arguments=arguments, files=(file,), kept=(secret, file), closed=(secret,))


DATA_SHARE = 0.35
KINDS = (
    Kind(name="hostile texts", share=0.45, size=160, make=_texts),
    *(
        Kind(name=f"hostile {kind}", share=DATA_SHARE / len(SOURCES), size=64, make=partial(_data, kind))
        for kind in SOURCES
    ),
    Kind(name="hostile options", share=0.1, size=80, make=_options),
    Kind(name="destinations", share=0.07, size=32, make=_destinations),
    Kind(name="confined problems", share=0.03, size=16, make=_confined),
)
