"""Equal subexpressions are computed once: kernels are about as short as a model written by hand."""

from __future__ import annotations

from pathlib import Path

import casadi
import numpy as np
import pytest

import mbm
from mbm.kernels.serialised import function_of
from tests.symbolic.derivatives import single

PROBLEMS = Path(__file__).parents[2] / "problems"


def steps(function):
    """Instructions that compute: without inputs, outputs and constants."""
    idle = (casadi.OP_INPUT, casadi.OP_OUTPUT, casadi.OP_CONST, casadi.OP_ASSIGN)
    return sum(function.instruction_id(k) not in idle for k in range(function.n_instructions()))


@pytest.mark.parametrize(
    ("text", "most"),
    [
        # exp, a·b once; two products.
        ("[(* a (exp (* a b))) (* b (exp (* a b)))]", 4),
        ("(+ (sin (* a b)) (cos (* a b)) (sin (* a b)))", 5),
        ("(* (hypot a b) (hypot a b))", 5),
        ("(let ((n (norm [a b x]))) [(/ a n) (/ b n) (/ x n)])", 9),
        ("(if (< (* a b) x) (* a b) x)", 6),
    ],
)
def test_repeated_parts_are_computed_once(text, most):
    _, kernel = single(text)
    assert len(kernel.value_program.instructions) <= most


def test_jacobian_shares_with_the_values():
    _, kernel = single("(exp (* a b))")
    # Value 2, slopes b·e and a·e: 2 more.
    assert len(kernel.jacobian_program.instructions) <= 4


def about(axis, angle, v):
    """A rotation of a vector about a coordinate axis: two products and a sum for each of two coordinates."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = list(v)
    turned[i] = casadi.cos(angle) * v[i] - casadi.sin(angle) * v[j]
    turned[j] = casadi.sin(angle) * v[i] + casadi.cos(angle) * v[j]
    return turned


def euler(angles, v):
    for axis, angle in enumerate(angles):
        v = about(axis, angle, v)
    return v


def plus(v, place):
    return [a + b for a, b in zip(v, place, strict=True)]


JOINTS = {
    "torso/larm/elbow/wrist/origin": ("lwr", ("lsh_phi", "lsh_th", "lsh_ps", "lelbow", "waist")),
    "lleg/knee/ankle/origin": ("lan", ("lhip_phi", "lhip_th", "lhip_ps", "lknee")),
}
"""A joint at the end of a chain, with the angles in the order in which ``chain_by_hand`` takes them."""
OTHERS = ("phi", "theta", "psi", "xg", "yg", "zg", "k0", "k1", "X", "Y")


def chain_by_hand(joint):
    """(X, Y) of the left wrist or ankle from the figure's angles, as one would write it: from the tip to the camera."""
    z = casadi.SX.sym("z", 64)
    symbols = iter(casadi.vertsplit(z))
    if joint == "lwr":
        arm, bend, waist = [next(symbols) for _ in range(3)], next(symbols), next(symbols)
        v = about(2, bend, [0.26, 0, 0])
        v = euler(arm, plus(v, [0.3, 0, 0]))
        v = about(2, waist, plus([-v[1], v[0], v[2]], [0, 0.2, 0.46]))
    else:
        leg, bend = [next(symbols) for _ in range(3)], next(symbols)
        v = about(1, bend, [0.4, 0, 0])
        v = euler(leg, plus(v, [0.42, 0, 0]))
        v = plus([v[2], v[1], -v[0]], [0, 0.1, 0])
    pose, place = [next(symbols) for _ in range(3)], [next(symbols) for _ in range(3)]
    v = plus(euler(pose, v), place)
    k0, k1, x, y = (next(symbols) for _ in range(4))
    outputs = casadi.vertcat(k0 * v[1] / v[0] - x, k1 * v[2] / v[0] - y)
    jacobian = casadi.jacobian(outputs, z)
    both = casadi.cse(casadi.vertcat(outputs, *jacobian.nonzeros()))
    return casadi.Function("values", [z], [casadi.cse(outputs)]), casadi.Function("both", [z], [both])


@pytest.fixture(scope="module")
def kernels():
    loaded = mbm.load(PROBLEMS / "skeleton" / "skeleton.mbm").named("skeleton-near")
    compiled = loaded.compile()
    block = compiled.elaborated.problem.blocks[0]
    found = {}
    for kernel in compiled.kernels.kernels:
        if kernel.purpose.value == "equation" and kernel.owner == 0:
            found[dict(block.cases[kernel.case].static)["path"]] = kernel
    return found


def name_of(slot):
    return getattr(getattr(slot, "member", None), "key", None) or getattr(slot, "unknown", None) or slot.name


@pytest.mark.parametrize("path", JOINTS)
def test_skeleton_is_as_short_as_a_model_by_hand(path, kernels):
    joint, angles = JOINTS[path]
    kernel = kernels[path]
    values, both = chain_by_hand(joint)
    # Matrices are multiplied before vectors where a rotation value is asked for: 40 % is what that may cost.
    assert len(kernel.value_program.instructions) <= 1.4 * steps(values)
    assert len(kernel.jacobian_program.instructions) <= 1.4 * steps(both)

    # The two are the same model.
    point = dict(zip((*angles, *OTHERS), np.random.default_rng(2).uniform(0.5, 1.5, 20), strict=False))
    inputs = [point[name_of(s)] for s in (*kernel.variables, *kernel.parameters)]
    by_hand = values(np.append(list(point.values()), np.zeros(64 - len(point))))
    # Some hundred operations on numbers near 1.
    np.testing.assert_allclose(
        np.asarray(function_of("values", kernel.value_program)(inputs)), np.asarray(by_hand), rtol=1e-12
    )
