"""Names that generated code has for itself: a problem may use them all, and what is made compiles and answers."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys

import pytest

from mbm.emit.identifiers import CASE_FORMS, DERIVED_CASE_FORMS, MACROS, PROBLEM_FORMS, TAKEN, Identifiers, identifier
from mbm.emit.python.program import PROGRAM, SHOWING
from mbm.emit.python.runtime import HEAD, TAIL
from mbm.emit.routines.modules import known
from mbm.machine.python import PRELUDE
from tests.emit.making import of_text, run, written
from tests.emit.shapes import SHAPES

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

LINE = "(0 1.1) (1 2.9) (2 5.1) (3 7.2)"
CLASHES = {
    "a problem called as its table": f"""(problem ranges
      (data ranges (table (x y) {LINE}))
      (unknowns (a :init 1) (b :init 0))
      (observe ranges (= y (+ (* a x) b)) :sigma 0.2))""",
    "words of the languages": f"""(problem class
      (data double (table (int in) {LINE}))
      (unknowns (while :init 1) (lambda :init 0))
      (observe return double (= in (+ (* while int) lambda)) :sigma 0.2)
      (derive (struct (* 2 while)) (None (+ lambda 1))))""",
    "macros and guards": f"""(problem x
      (constants (BUFSIZ 1) (offset 1))
      (data X (table (H NULL) {LINE}))
      (data FP (table (NAN y) {LINE}))
      (unknowns (X_TABLES :init 1) (TOLERANCE :init 0) (EOF :init 0 :sigma 1) (constant_offset :init 0 :sigma 1))
      (observe X (= NULL (+ (* X_TABLES H) (* BUFSIZ TOLERANCE) (* offset EOF))) :sigma 0.2)
      (observe FP (= y (+ (* X_TABLES NAN) TOLERANCE constant_offset)) :sigma 0.2))""",
    "files and programs": f"""(problem csv
      (data CSV (table (H y) {LINE}))
      (data csv (table (H y) {LINE}))
      (unknowns (printf :init 1) (main :init 0))
      (observe residuals CSV (= y (+ (* printf H) main)) :sigma 0.2)
      (observe derived csv (= y (+ (* printf H) main)) :sigma 0.2)
      (observe jac csv (= y (+ (* printf H) main)) :sigma 0.2)
      (derive (hess (* 2 printf))))""",
    "members and functions": f"""(problem set
      (constants (start 2))
      (data start (table (b rows) {LINE}))
      (data find (table (b rows) {LINE}))
      (unknowns (a :init 1) (c :init 0) (a_sigma :init 0 :sigma 1) (a-sigma :init 0 :sigma 1)
        (a_members :init 0 :sigma 1) (rows-of-start :init 0 :sigma 1))
      (observe all start (= start.rows (+ (* a start.b) c (* start a_sigma))) :sigma 0.2 :when (> start.b -1))
      (observe kept find (= find.rows (+ (* a find.b) c a_members)) :sigma 0.2)
      (observe load find (= find.rows (+ (* a find.b) c rows-of-start)) :sigma 0.2)
      (derive (rows (+ a 1)) (a_rows (+ a a_sigma)) (set_up (+ a a-sigma))))""",
    "functions of kernels": """(problem signal
      (data d (table (copysign fabs kernel_sign t1) (0 1.1 1 0.1) (1 2.9 2 0.2) (2 5.1 1 0.1) (3 6.8 3 0.2)))
      (unknowns (asinh :init 1) (np :init 0))
      (observe d (= fabs (+ (* asinh copysign) (sign (+ np 5)) np (abs kernel_sign) (asinh kernel_sign) (* t1 t1 np)))
        :sigma 0.2))""",
    "letters of no name here": f"""(problem \N{TIBETAN LETTER -A}
      (data 中 (table (x y) {LINE}))
      (data 文 (table (x y) {LINE}) :where (> x 0))
      (unknowns (ا :init 1) (\N{TIBETAN LETTER -A} :init 0) (名 :init 0 :sigma 1 :fixed false))
      (observe 中 (= y (+ (* ا x) \N{TIBETAN LETTER -A} 名)) :sigma 0.2)
      (observe 文 (= y (+ (* ا x) \N{TIBETAN LETTER -A})) :sigma 0.2))""",
    "long names": "(problem {p} (data {d} (table ({x} y) {rows})) (unknowns ({a} :init 1) ({b} :init 0))"
    " (observe {d} (= y (+ (* {a} {x}) {b})) :sigma 0.2))".format(
        p="p" * 3000, d="d" * 3000, x="x" * 3000, a="n" * 3000, b="n" * 3001, rows=LINE
    ),
    "words in texts": """(problem texts
      (data t (table (k) ("kernel_sign(") ("place_of_number(") ("for (i =")) :key k)
      (data d (table (k y) ("kernel_sign(" 1) ("place_of_number(" 2) ("for (i =" 3)) :where (= k "for (i ="))
      (data e (table (k y) ("kernel_sign(" 1) ("place_of_number(" 2) ("for (i =" 3)))
      (unknowns (a :per t :init 1 :doc "snprintf(key"))
      (observe e (= y (a k)) :sigma 0.2)
      (observe d (= y (a k)) :sigma 0.2)
      (constraints (<= (a "kernel_sign(") 5)))""",
}


@needs_compiler
@pytest.mark.parametrize("name", CLASHES)
def test_c_compiles_and_answers(name, tmp_path):
    folder = written(of_text(CLASHES[name], "c"), tmp_path)
    made = run("make", "all", "test", "CFLAGS=-O0", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr


@needs_compiler
@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake is here")
@pytest.mark.parametrize(
    "name", ["install", *(pytest.param(name, marks=pytest.mark.slow) for name in ("m", "test", "all", "data", "build"))]
)
def test_targets_of_make_and_cmake_are_no_names_of_problems(name, tmp_path):
    text = CLASHES["a problem called as its table"].replace("(problem ranges", f"(problem {name}")
    folder = written(of_text(text, "c"), tmp_path)
    made = run("make", "all", "test", "CFLAGS=-O0", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr
    for arguments in (("-B", "made", "."), ("--build", "made"), ("--build", "made", "--target", "test")):
        made = run("cmake", *arguments, folder=folder)
        assert made.returncode == 0, made.stdout + made.stderr


@pytest.mark.parametrize("target", ["python", "casadi"])
@pytest.mark.parametrize("name", CLASHES)
def test_python_and_casadi_answer(name, target, tmp_path):
    files = of_text(CLASHES[name], target)
    assert len({file.path.lower() for file in files}) == len(files)
    folder = written(files, tmp_path)
    test = next(path.name for path in folder.iterdir() if path.name.startswith("test_"))
    found = run(sys.executable, test, folder=folder)
    assert found.returncode == 0, found.stdout + found.stderr


@pytest.mark.parametrize(
    ("name", "file"), [("main", "main_"), ("CSV", "CSV_"), ("a/b", "a_b"), ("../../x", "x"), (".", "unnamed")]
)
def test_files_are_called_as_the_problem_but_for_those_of_others(name, file):
    text = CLASHES["a problem called as its table"].replace("(problem ranges", f"(problem {name}")
    paths = [each.path for each in of_text(text, "c")]
    assert f"{file}.c" in paths
    assert len({path.lower() for path in paths}) == len(paths)


@pytest.mark.parametrize("name", ["numpy", "csv", "signal", "numbers", "pytest"])
def test_no_module_hides_one_that_is_imported(name, tmp_path):
    text = CLASHES["a problem called as its table"].replace("(problem ranges", f"(problem {name}")
    folder = written(of_text(text, "python"), tmp_path)
    assert not (folder / f"{name}.py").exists()
    found = run(sys.executable, f"test_{name}_.py", folder=folder)
    assert found.returncode == 0, found.stdout + found.stderr


@needs_compiler
def test_macros_of_the_headers_are_known():
    """But for those of functions, which a name without a parenthesis behind it does not call."""
    headers = ("ctype", "limits", "math", "stddef", "stdio", "stdlib", "string")
    includes = "".join(f"#include <{name}.h>\n" for name in headers)
    command = ["cc", "-std=c99", "-dM", "-E", "-"]
    found = subprocess.run(command, input=includes, capture_output=True, text=True, check=True).stdout
    macros = set(re.findall(r"^#define ([A-Za-z]\w*) ", found, re.MULTILINE))
    assert len(macros) > 20
    assert macros <= MACROS


def test_functions_that_a_name_could_become_are_taken():
    """Those of the solver in both languages, and those of the Python around it."""
    fixed = set(known())
    for source in (HEAD, TAIL, SHOWING, PROGRAM, PRELUDE):
        for node in ast.parse(source).body:
            names = node.targets if isinstance(node, ast.Assign) else [node]
            fixed |= {getattr(each, "name", getattr(each, "id", None)) for each in names} - {None}
    ends = [form.removeprefix("function.{name}") for form in (*CASE_FORMS, *DERIVED_CASE_FORMS, *PROBLEM_FORMS)]
    ends = ["_rows", *(end for end in ends if end.startswith("_"))]
    could = {name for name in fixed if any(name.removesuffix(end) not in ("", name) for end in ends)}
    begins = "(set_up|derive|constant|(start|(least|greatest)(_start)?|fixed)_of)_"
    could |= {name for name in fixed if re.match(f"{begins}|.*_(when|kept|[0-9]+)$", name)}
    assert len(could) > 10
    assert {f"function.{name}" for name in could if not name.startswith("_")} <= TAKEN


def test_members_of_the_result_are_taken():
    files = {file.path: file.content.decode() for file in of_text(CLASHES["a problem called as its table"], "c")}
    text = files["ranges.h"]
    inside = text[text.index("typedef struct {\n    int status;") : text.index("} ranges_result;")]
    own = {"a", "a_sigma", "b", "b_sigma"}
    members = set(re.findall(r"[\w]+(?=[,;])", re.sub(r"/\*.*?\*/", "", inside)))
    assert {"status", "covariance"} <= members
    assert {f"result.{name}" for name in members - own} <= TAKEN


@pytest.mark.parametrize("name", ["startless", "derived", "keys", "distinct"])
def test_members_of_the_frame_are_taken(name):
    files = {file.path: file.content.decode() for file in of_text(SHAPES[name], "c")}
    text = files[f"{name}.c"]
    inside = text[text.index("struct frame {") : text.index("static void lay_out")].partition("\n};")[0]
    members = set(re.findall(r"\w+(?=\[|[,;])", re.sub(r"/\*.*?\*/", "", inside)))
    own = {each for each in members if re.search("_of_|_members|^(derived|h)_", each)}
    assert {"system", "weights"} <= members
    assert {f"frame.{each}" for each in members - own} <= TAKEN


def test_a_name_differs_in_all_that_is_made_of_it():
    names = Identifiers(frozenset({"m.a_rows"}))
    assert names.made("a", "m.{name}", "m.{name}_rows") == "a_"
    assert names.made("a_", "m.{name}") == "a"
    assert names.made("B", "file.{lower}") == "B"
    assert names.made("b", "file.{lower}") == "b_"
    assert names.made("NaN") == "NaN"
    assert names.made("NAN") == "NAN_"


def test_a_name_is_made_of_letters_and_digits():
    assert identifier("../x*/") == "x"
    assert identifier("\N{TIBETAN LETTER -A}b") == "ab"
    assert identifier("中") == "unnamed"
    assert identifier("2nd") == "n2nd"
