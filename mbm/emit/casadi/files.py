"""All files of the target ``casadi``: serialised functions, and a description of their inputs and outputs. Texts in
JSON: the only way that a `Foreign` gets into the documents beside CasADi functions.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

from mbm.emit.foreign import Foreign, told
from mbm.emit.markdown import prose
from mbm.emit.types import BlockCase, Blueprint, ColumnValue, InputValue, OutputFile
from mbm.emit.words import described
from mbm.kernels.serialised import serialised_kernel, serialised_whole


def document(value: object, *, indent: int | None = None) -> str:
    """A document with a line break at its end; what is not printable is written by its number."""
    text = json.dumps(_plain(value), indent=indent, ensure_ascii=False)
    return "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in text) + "\n"


def _plain(value: object) -> object:
    """The value with texts for what is foreign, names of members too."""
    if isinstance(value, Foreign):
        return value.unescaped
    if isinstance(value, dict):
        return {_plain(key): _plain(held) for key, held in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def casadi_files(blueprint: Blueprint) -> tuple[OutputFile, ...]:
    """The functions of each kernel and of all rows together, ``functions.json``, README, a test."""
    made: dict[str, str] = {}
    for case in (*(c for _, c in blueprint.cases), *(c for d in blueprint.derived for c in d.cases)):
        made[f"{case.identifier}.casadi"] = serialised_kernel(case.identifier, case.kernel)
    whole = blueprint.whole
    numbers, coordinates = len(whole.start), len(whole.names)
    made["residuals.casadi"] = serialised_whole("residuals", numbers, coordinates, whole.bound)
    if whole.derived:
        rows = [each for derived in whole.derived for each in derived.bound]
        made["derived.casadi"] = serialised_whole("derived", numbers, coordinates, rows)
    unknowns = [
        {"name": u.name, "kind": u.kind.value, "numbers": u.size, "coordinates": u.freedom, "unit": u.unit}
        for u in blueprint.unknowns
    ]
    functions = {
        "problem": blueprint.name,
        "mbm": blueprint.version,
        "kernels": [{"clause": b.name, "role": b.role.value, **_kernel(blueprint, c)} for b, c in blueprint.cases],
        "residuals": {
            "file": "residuals.casadi",
            "inputs": ["point"],
            "outputs": ["residuals", "jacobian"],
            "numbers": numbers,
            "coordinates": list(whole.names),
            "rows": len(whole.residuals),
            "start": whole.start.tolist(),
        },
        "derived": _derived(blueprint),
        "unknowns": unknowns,
        "constants": {c.name: c.value for c in blueprint.constants},
    }
    made["functions.json"] = document(functions, indent=2)
    made["README.md"] = "\n".join([*_readme(blueprint), *described(blueprint)]) + "\n"
    made["test_functions.py"] = TEST
    made["reference.json"] = _reference(blueprint)
    return tuple(OutputFile(path=path, content=text.encode()) for path, text in made.items())


def _kernel(blueprint: Blueprint, case: BlockCase) -> dict[str, object]:
    """Inputs and outputs of the function of a kernel."""
    return {
        "file": f"{case.identifier}.casadi",
        "inputs": list(case.input_names),
        "unknowns": len(case.variables),
        "parameters": [_shown(value) for value in case.parameters],
        "where": {value.column or "row": key for value, key in case.static},
        "outputs": case.kernel.outputs,
        "coordinates": [[blueprint.unknowns[s.unknown].name, s.component + 1] for s in case.tangents],
        "equations": list(case.text),
    }


def _derived(blueprint: Blueprint) -> dict[str, object] | None:
    """The function of all derived quantities and what its lines are: quantity by quantity, row by row."""
    if not blueprint.derived:
        return None
    quantities = [
        {
            "name": shape.name,
            "table": shape.table,
            "rows": [row + 1 for row in rows.rows],
            "size": shape.size,
            "unit": shape.unit,
            "factor": shape.scale.factor,
            "zero": shape.scale.zero,
            "kernels": [_kernel(blueprint, case) for case in shape.cases],
        }
        for shape, rows in zip(blueprint.derived, blueprint.whole.derived, strict=False)
    ]
    lines = {"file": "derived.casadi", "inputs": ["point"], "outputs": ["derived", "jacobian"]}
    return {**lines, "quantities": quantities}


def _shown(value: InputValue) -> Foreign:
    """A parameter in words."""
    if not isinstance(value, ColumnValue):
        return value.name
    return told(value.owner, ".", value.column or "row number")


def _reference(blueprint: Blueprint) -> str:
    """Residuals and Jacobian at the start, derived quantities at the answer, as mbm itself has them."""
    whole = blueprint.whole
    rows, columns = whole.jacobian.nonzero()
    slopes = [[int(i), int(j), float(whole.jacobian[i, j])] for i, j in zip(rows, columns, strict=True)]
    found: dict[str, object] = {"point": whole.start.tolist(), "residuals": whole.residuals.tolist()}
    found["jacobian"] = slopes
    if whole.derived:
        found["answer"] = whole.answer.tolist()
        found["covariance"] = whole.covariance.tolist()
        found["derived"] = [value for each in whole.derived for value in each.values.tolist()]
        found["sigma"] = [value for each in whole.derived for value in each.sigma.tolist()]
    return document(found)


def _readme(blueprint: Blueprint) -> Iterator[str]:
    yield from (
        f"# {prose(blueprint.name)}",
        "",
        *((prose(blueprint.doc), "") if blueprint.doc else ()),
        f"Serialised CasADi functions, written by mbm {blueprint.version}; `functions.json` names inputs and outputs.",
        "",
        "```python",
        "import casadi",
        "",
        'residuals = casadi.Function.deserialize(open("residuals.casadi").read())',
        "r, J = residuals(point)    # all numbers in SI → whitened residuals, and their derivatives",
        "```",
        "",
        "`residuals.casadi` holds the data of the tables that it was made with",
        "(of the first data set, where there are several), without losses; the other files have one function for each",
        "group of rows, from the unknowns and the data of one row to its equations (not divided by their noise) and",
        "their derivatives. Derivatives are by steps in the tangent space: a rotation has three, `q Exp(ω)`.",
    )
    if blueprint.derived:
        yield from (
            "`derived.casadi` gives the derived quantities of all rows at a point and their derivatives J by the",
            "coordinates: with the covariance C of these, `J C Jᵀ` is theirs.",
        )
    yield from ("`python test_functions.py` compares with the numbers of mbm.", "")


TEST = '''"""The functions give the numbers of mbm: `python test_functions.py`, or pytest."""

from __future__ import annotations

import json
from pathlib import Path

import casadi
import numpy as np

FOLDER = Path(__file__).parent


def load(name: str) -> casadi.Function:
    """A function of the folder."""
    return casadi.Function.deserialize((FOLDER / name).read_text(encoding="utf-8"))


def test_residuals_and_jacobian() -> None:
    """As mbm has them at the start, to the rounding of another order of operations."""
    reference = json.loads((FOLDER / "reference.json").read_text(encoding="utf-8"))
    residuals, jacobian = load("residuals.casadi")(reference["point"])
    wanted = np.array(reference["residuals"])
    assert np.allclose(np.array(residuals).ravel(), wanted, rtol=1e-10, atol=1e-10 * np.abs(wanted).max(initial=0.0))
    slopes = np.zeros(jacobian.shape)
    for row, column, value in reference["jacobian"]:
        slopes[row, column] = value
    assert np.allclose(np.array(jacobian.full()), slopes, rtol=1e-10, atol=1e-10 * np.abs(slopes).max(initial=0.0))


def test_derived_quantities() -> None:
    """As mbm has them at the answer, with their standard deviations where these are known."""
    reference = json.loads((FOLDER / "reference.json").read_text(encoding="utf-8"))
    if "derived" not in reference:
        return
    values, jacobian = load("derived.casadi")(reference["answer"])
    wanted = np.array(reference["derived"])
    assert np.allclose(np.array(values).ravel(), wanted, rtol=1e-10, atol=1e-10 * np.abs(wanted).max(initial=0.0))
    slopes, sigma = np.array(jacobian.full()), np.array(reference["sigma"])
    moving = (slopes != 0.0).any(axis=0)
    covariance = np.array(reference["covariance"]).reshape(moving.size, moving.size)[np.ix_(moving, moving)]
    found = np.sqrt(np.einsum("ij,jk,ik->i", slopes[:, moving], covariance, slopes[:, moving]))
    known = np.isfinite(sigma) & np.isfinite(found)
    assert np.allclose(found[known], sigma[known], rtol=1e-10, atol=0.0)


def test_kernels_are_named() -> None:
    """Every function has the inputs and outputs that `functions.json` says."""
    functions = json.loads((FOLDER / "functions.json").read_text(encoding="utf-8"))
    quantities = functions["derived"]["quantities"] if functions["derived"] else []
    for kernel in (*functions["kernels"], *(k for quantity in quantities for k in quantity["kernels"])):
        function = load(kernel["file"])
        assert function.size1_in(0) == len(kernel["inputs"])
        assert function.size1_out(0) == kernel["outputs"]
        assert function.size2_out(1) == len(kernel["coordinates"])


if __name__ == "__main__":
    test_residuals_and_jacobian()
    test_derived_quantities()
    test_kernels_are_named()
    print("all functions agree")
'''
