"""Figures 4 to 7 of Oyama & Tachi 1989, run as printed (with the back-quote that Fig. 6 lacks)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Component
from mbm.language.limits import Limits
from mbm.language.scope import LocalScope
from mbm.language.session import open_session, read_program
from mbm.language.values import Array, Value
from mbm.shapes.model import make_model
from mbm.shapes.vocabulary import vocabulary
from mbm.text.printer import print_form
from mbm.text.reader import read
from mbm.text.types import Source

FIGURES = """
(rectangular (x y)
  (vertexes (1 (x y 0)) (2 ((- x) y 0)) (3 ((- x) (- y) 0)) (4 (x (- y) 0)))
  (lines (1 (1 2)) (2 (2 3)) (3 (3 4)) (4 (4 1)))
  (planes (1 (1 2 3 4)) (2 (1 4 3 2))))

(desk (x y r h &optional (dx 0.03) (dy 0.03))
  (declare (x2 (- (/ x 2) dx)) (y2 (- (/ y 2) dy))
           (array leg (leg1 leg2 leg3 leg4))
           (array legpos ((x2 y2 0) ((- x2) y2 0) ((- x2) (- y2) 0) (x2 (- y2) 0))))
  (board (trans (0 0 h) (rectangular x y)))
  (for (i 1 4)
    ((leg i) (trans (legpos i) (cylinder r h)))))

(defun vertex-on-model (Att Pos Model Vertex)
  `(perse (trans (list ,@Pos) (rotate (list ,@Att) ,(get-vertex-from-model Model Vertex)))))

(defun vertex-on-image-vertex-on-model (Vim Att Pos Model Vertex)
  `(subvv 2 ,(vertex-on-model Att Pos Model Vertex) (list ,@Vim)))
"""
CALL = """(vertex-on-image-vertex-on-model (list 10.0 -10.0) '(f t p) '(xg yg zg) '(desk x y r h)
                                                    '(desk (board (vertex 1))))"""
EXPANSION = (
    "(subvv 2 (perse (trans (list xg yg zg) (rotate (list f t p) (trans (list 0 0 h) (list x y 0))))) "
    "(list 10.0 -10.0))"
)
NAMES = ("f", "t", "p", "xg", "yg", "zg", "x", "y", "r", "h")
VALUES = dict(zip(NAMES, (0.1, -0.2, 0.3, 3.0, 0.3, -1.5, 0.6, 0.35, 0.025, 0.7), strict=True))


@pytest.fixture
def figures():
    words = vocabulary()
    program = read_program(
        Source("figures.mbm", FIGURES),
        Path("figures.mbm"),
        sandbox=None,
        limits=Limits(),
        reserved=frozenset(words.special_forms),
    )
    return open_session(program, words, make_model, Limits())


def _form(text: str):
    return read(Source("place", text))[0]


def _numbers(value: Value) -> np.ndarray:
    assert isinstance(value, Array)
    return np.array(evaluate(value.elements, lambda leaf: VALUES[leaf.unknown]), dtype=float)


def _unknowns(session) -> LocalScope:
    return LocalScope({name: Component(name) for name in NAMES}, session.scope)


def test_figure_6_expands_to_the_form_of_the_contract(figures):
    assert print_form(figures.evaluator.evaluate(_form(CALL), figures.scope)) == EXPANSION


def test_the_form_that_arrives_is_the_observation_model(figures):
    # F(φ,θ,ψ) = Rz Ry Rx written out with NumPy, perse with k0 = k1 = 1
    (cf, ct, cp), (sf, st, sp) = (fn([VALUES["f"], VALUES["t"], VALUES["p"]]) for fn in (np.cos, np.sin))
    rz = np.array([[cp, -sp, 0], [sp, cp, 0], [0, 0, 1]])
    ry = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
    rx = np.array([[1, 0, 0], [0, cf, -sf], [0, sf, cf]])
    point = rz @ ry @ rx @ [VALUES["x"], VALUES["y"], VALUES["h"]] + [VALUES["xg"], VALUES["yg"], VALUES["zg"]]
    expected = point[1:] / point[0] - [10.0, -10.0]
    found = _numbers(figures.evaluator.wanted(_form(CALL), _unknowns(figures)))
    np.testing.assert_allclose(found, expected, rtol=1e-14)  # a dozen roundings of doubles


def test_the_direct_feature_says_the_same(figures):
    scope = _unknowns(figures)
    model = "(desk x y r h)"
    for path, direct in (
        ("(desk (board (vertex 3)))", f"(vertex {model} board 3)"),
        ("(desk (leg2 (vertex 8)))", f"(vertex {model} leg2 8)"),
        ("(desk (leg4 (origin)))", f"(origin {model} leg4)"),
        ("(desk (leg1 (top)))", f'(feature {model} "leg1/top")'),
    ):
        quoted = figures.evaluator.wanted(_form(f"(get-vertex-from-model '{model} '{path})"), scope)
        np.testing.assert_allclose(
            _numbers(quoted), _numbers(figures.evaluator.wanted(_form(direct), scope)), rtol=1e-15
        )


def test_a_form_keeps_what_the_arguments_were(figures):
    form = _form("(get-vertex-from-model '(desk 60cm (* 2 y) r h) '(board (vertex 2)))")
    printed = print_form(figures.evaluator.evaluate(form, figures.scope))
    assert printed == "(trans (list 0 0 h) (list -0.6m (* 2 y) 0))"


def test_figure_4_numbers_its_features_as_printed(figures):
    vertexes = [
        _numbers(figures.evaluator.wanted(_form(f"(vertex (rectangular 2 1) {n})"), figures.scope)) for n in range(1, 5)
    ]
    np.testing.assert_array_equal(vertexes, [(2, 1, 0), (-2, 1, 0), (-2, -1, 0), (2, -1, 0)])
    line = figures.evaluator.wanted(_form("(line (rectangular 2 1) 4)"), figures.scope)
    np.testing.assert_array_equal([_numbers(line.start), _numbers(line.end)], [(2, -1, 0), (2, 1, 0)])
    plane = figures.evaluator.wanted(_form("(plane (rectangular 2 1) 2)"), figures.scope)
    np.testing.assert_array_equal([_numbers(p) for p in plane.points], [vertexes[i] for i in (0, 3, 2, 1)])
