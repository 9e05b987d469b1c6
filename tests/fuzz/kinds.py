"""The kinds of random cases: which command reads what, with which options, and what has to hold afterwards."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

from tests.fuzz.forms import Forms, Names
from tests.fuzz.mutations import CELL, ODD_CELLS, mutated_bytes, mutated_text
from tests.fuzz.options import option_lists, values_file
from tests.fuzz.problems import Problems, problem_file
from tests.trials.choices import Choices
from tests.trials.kinds import Case, Home, Kind
from tests.trials.outcome import SLOWEST_SOLVE, Outcome, faults_of, outcome

ROOT = Path(__file__).parents[2]
NODES = "id,x,y,z,name\n1,0,0,2,p\n2,4,0,2,q\n3,0,4,2,p\n"
READINGS = "id,x,y,name,long\n1,1.5,2.5,p,1\n2,2.25,3.75,q,2\n3,3.5,4.5,p,3\n1,4.75,6.5,q,4\n2,6.5,8.25,p,5\n"
GENERATED, MUTATED = 320, 24
"""Bytes that decide a problem file, and those that decide changes to one."""
CHARACTERS = "()[]'`,@;#|\"\\ \na1-./:%é\x00"
STAGES = ("forms", "problem", "symbolic", "kernels")


def home(folder: Path) -> Home:
    """The folder with the tables that generated problems read, and copies of sound and faulty problem files."""
    write_tables(folder)
    sources = [ROOT / "tests" / "bad", *(ROOT / "mbm" / "cli" / "templates").iterdir(), *(ROOT / "problems").iterdir()]
    examples = folder / "examples"
    for source in sources:
        if source.is_dir():
            shutil.copytree(
                source, examples / source.name, ignore=shutil.ignore_patterns("*.py", "*.png", "__pycache__")
            )
    files = sorted(path for path in examples.rglob("*.mbm") if path.stat().st_size < 20_000)
    return Home(folder=folder, examples=tuple(files))


def write_tables(folder: Path) -> None:
    """The tables that generated problems read."""
    (folder / "nodes.csv").write_text(NODES, encoding="utf-8")
    (folder / "readings.csv").write_text(READINGS, encoding="utf-8")


def _generated(here: Home, choices: Choices) -> Path:
    file = here.folder / "generated.mbm"
    file.write_text(Problems(choices).file(), encoding="utf-8")
    return file


def _mutated(here: Home, choices: Choices) -> Path:
    example = choices.one_of(here.examples)
    file = example.parent / "mutated-copy.mbm"
    if choices.chance(5):
        file.write_bytes(mutated_bytes(example.read_bytes(), choices))
    else:
        file.write_text(mutated_text(example.read_text(encoding="utf-8", errors="replace"), choices), encoding="utf-8")
    return file


def _checked(here: Home, choices: Choices) -> Case:
    options = ("--strict-units",) if choices.chance(8) else ()
    file = _generated(here, choices)
    return Case(arguments=("check", str(file), "--json", "-", *options), files=(file,))


def _mutated_checked(here: Home, choices: Choices) -> Case:
    file = _mutated(here, choices)
    return Case(arguments=("check", str(file), "--json", "-"), files=(file,))


def _tables_checked(here: Home, choices: Choices) -> Case:
    folder = here.cleared("data")
    write_tables(folder)
    file = folder / "sound.mbm"
    file.write_text(problem_file(b""), encoding="utf-8")
    table = folder / choices.one_of(("nodes.csv", "readings.csv"))
    content = mutated_text(table.read_text(encoding="utf-8"), choices, CELL, ODD_CELLS).encode()
    table.write_bytes(mutated_bytes(content, choices) if choices.chance(3) else content)
    return Case(arguments=("check", str(file), "--json", "-"), files=(file, table))


def _noise(choices: Choices) -> bytes:
    count = choices.below(200)
    if choices.chance(2):
        return bytes(choices.below(256) for _ in range(count))
    return "".join(choices.one_of(CHARACTERS) for _ in range(count % 60)).encode()


def _noise_checked(here: Home, choices: Choices) -> Case:
    file = here.folder / "noise.mbm"
    file.write_bytes(_noise(choices))
    return Case(arguments=("check", str(file), "--json", "-"), files=(file,))


def _solved(here: Home, choices: Choices) -> Case:
    # Machine code of a problem takes longer to make than its solve: every eighth has it.
    backend = "auto" if choices.below(8) == 7 else "numpy"
    results = here.cleared("results")
    options = [f"--{name}={results / f'{name}.csv'}" for name in ("csv", "residuals") if choices.chance(2)]
    screen = ("-v",) if choices.chance(3) else ("--json", "-")
    file = _generated(here, choices)
    return Case(arguments=("solve", str(file), "--backend", backend, *screen, *options), files=(file,))


def _tables_are_whole(here: Home, _case: Case, _found: Outcome) -> list[str]:
    """Every row of what was written has as many cells as there are names of columns."""
    wrong = []
    for path in (here.folder / "results").iterdir():
        with path.open(encoding="utf-8", newline="") as stream:
            widths = {len(row) for row in csv.reader(stream)}
        if len(widths) > 1:
            wrong.append(f"{path.name} has rows of {sorted(widths)} cells")
    return wrong


def _laid_out(here: Home, choices: Choices) -> Case:
    match choices.below(4):
        case 0:
            file = here.folder / "noise.mbm"
            file.write_bytes(_noise(choices))
        case 1:
            file = _generated(here, choices)
        case _:
            file = _mutated(here, choices)
    before = file.with_suffix(".before")
    before.write_bytes(file.read_bytes())
    return Case(arguments=("fmt", str(file)), files=(before, file))


def _layout_is_kept(here: Home, case: Case, found: Outcome) -> list[str]:
    """What was laid out is not changed by laying it out again, and what could not be read is as it was."""
    before, file = case.files
    if found.status == 2:
        return [] if before.read_bytes() == file.read_bytes() else ["a file that could not be read was changed"]
    again = outcome("fmt", "--check", str(file))
    return faults_of(again, (), here.folder) + ([] if again.status == 0 else ["a second layout differs"])


def _expanded(here: Home, choices: Choices) -> Case:
    names = Names(numbers=["2", "pi", "1/2"], vectors=["[1 2 3]"], rotations=["(rot-x 1)"])
    forms = Forms(choices, names)
    form = (forms.number, forms.condition, forms.wild)[choices.below(3)](3)
    file = _generated(here, choices)
    return Case(arguments=("expand", str(file), "--", form), files=(file,))


def _explained(here: Home, choices: Choices) -> Case:
    options = [f"--stage={choices.one_of(STAGES)}"] if choices.chance(2) else []
    if choices.chance(3):
        options.append("--latex")
    file = _generated(here, choices)
    return Case(arguments=("explain", str(file), *options), files=(file,))


def _simulated(here: Home, choices: Choices) -> Case:
    made = here.cleared("simulated")
    at = values_file(here.folder / "at.json", choices)
    chosen = [option for option in (f"--seed={choices.below(5)}", "--draw-priors") if choices.chance(3)]
    if choices.chance(8):
        chosen.append(choices.one_of(("--noise=readings=2", "--measured=readings=y", "--noise=readings=x")))
    if choices.chance(5):
        chosen += ["--at", str(at)]
    if choices.chance(4):
        chosen += ["--outliers", "0.5", "10"]
    file = _generated(here, choices)
    return Case(arguments=("simulate", str(file), "-o", str(made / "folder"), *chosen), files=(file, at))


def _simulation_is_sound(here: Home, case: Case, found: Outcome) -> list[str]:
    """What was simulated can be read again, if the problem itself can be solved."""
    made = here.folder / "simulated" / "folder"
    if found.status != 0:
        return []
    problems = sorted(made.glob("*.mbm"))
    if len(problems) != 1:
        return [f"{len(problems)} problems in the folder"]
    again = outcome("check", str(problems[0]))
    wrong = faults_of(again, (), made)
    if again.status != 0 and outcome("check", str(case.files[0])).status == 0:
        wrong.append(f"the folder cannot be read:\n{again.err[:500]}")
    if not isinstance(json.loads((made / "truth.json").read_text(encoding="utf-8")), dict):
        wrong.append("truth.json holds no object")
    return wrong


def _compiled(here: Home, choices: Choices) -> Case:
    made = here.cleared("compiled")
    target = choices.one_of(("python", "c", "casadi"))
    file = _generated(here, choices)
    return Case(arguments=("compile", str(file), "--target", target, "-o", str(made / "folder")), files=(file,))


def _modules_are_python(here: Home, _case: Case, found: Outcome) -> list[str]:
    if found.status != 0:
        return []
    wrong = []
    for path in (here.folder / "compiled" / "folder").rglob("*.py"):
        try:
            compile(path.read_text(encoding="utf-8"), path.name, "exec")
        except (SyntaxError, ValueError) as error:
            wrong.append(f"{path.name} is no Python: {error}")
    return wrong


SMALL = """(problem small "a \\"problem\\""
  (constants (h 2m))
  (data readings (csv "readings.csv"))
  (unknowns (a :init 1 :in (-100 100)) (w angle :init 10deg) (v (vector 2) :init [1 2])
    (p :per readings.name :init 1) (T (pose 2) :init (pose2 0.1 1 2)))
  (observe readings (= y (+ a (* x (sin w)) (p name))) :sigma unknown)
  (observe (= [1 2] v) :sigma 1)
  (observe (= (pose2 0 1 1) T) :sigma 1)
  (constraints (normal a 1 1)))
"""


def _with_options(here: Home, choices: Choices) -> Case:
    folder = here.cleared("options")
    write_tables(folder)
    file = folder / "small.mbm"
    file.write_text(SMALL, encoding="utf-8")
    arguments, files = option_lists(folder, choices)
    return Case(arguments=(*arguments, str(file)), files=(file, *files))


KINDS = (
    Kind(name="generated problems are checked", share=0.4, size=GENERATED, make=_checked),
    Kind(name="mutated problems are checked", share=0.24, size=MUTATED, make=_mutated_checked),
    Kind(name="mutated tables are checked", share=0.06, size=MUTATED, make=_tables_checked),
    Kind(name="noise is checked", share=0.08, size=240, make=_noise_checked),
    Kind(
        name="generated problems are solved",
        share=0.03,
        size=GENERATED,
        make=_solved,
        after=_tables_are_whole,
        slowest=SLOWEST_SOLVE,
    ),
    Kind(name="files are laid out", share=0.07, size=GENERATED, make=_laid_out, after=_layout_is_kept),
    Kind(name="forms are expanded", share=0.05, size=GENERATED, make=_expanded),
    Kind(name="generated problems are explained", share=0.02, size=GENERATED, make=_explained),
    Kind(name="problems are simulated", share=0.02, size=GENERATED, make=_simulated, after=_simulation_is_sound),
    Kind(name="problems are compiled", share=0.005, size=GENERATED, make=_compiled, after=_modules_are_python),
    Kind(name="options are read", share=0.025, size=80, make=_with_options, slowest=SLOWEST_SOLVE),
)
"""Shares by what a case costs: a solve takes as long as ten checks."""
