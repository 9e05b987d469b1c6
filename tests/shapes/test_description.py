"""What may stand in a model's body, and the frames that follow from it."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.expression.nodes import Column
from mbm.language.values import StaticColumnNeeded, TextColumn
from mbm.shapes.types import Group, ModelCall, Moved, Part


@pytest.mark.parametrize(
    ("body", "path", "expected"),
    [
        # the frame of a part: the chain of transforms with one child each
        ("(p (trans (1 0 0) (rotate (0 0 90deg) (trans (1 0 0) (sphere 1)))))", "p/origin", (1, 1, 0)),
        ("(trans (5 0 0) (p (trans (1 0 0) (sphere 1))))", "p/origin", (6, 0, 0)),
        # ends at a transform with two children, at a model call, at any other form
        ("(p (trans (1 0 0) (a (sphere 1)) (b (sphere 2))))", "p/origin", (0, 0, 0)),
        ("(p (trans (1 0 0) (sphere 1)) (q (sphere 1)))", "p/origin", (0, 0, 0)),
        ("(p (trans (1 0 0) (shifted)))", "p/origin", (1, 0, 0)),
        ("(p (trans (1 0 0) (or (trans (1 0 0) (sphere 1)))))", "p/origin", (1, 0, 0)),
        ("(p (trans (1 0 0) (let ((k 1)) (trans (k 0 0) (sphere 1)))))", "p/origin", (1, 0, 0)),
        # features see every transform, model calls add no level, named points
        ("(p (trans (1 0 0) (shifted)))", "p/vertex/1", (12, 0, 0)),
        ("(p (trans (1 0 0) (shifted)))", "p/inner/mid", (21, 0, 0)),
        ("(p (trans (1 0 0) (point tip (0 0 3)) (sphere 1)))", "p/tip", (1, 0, 3)),
        # transforms
        ("(p (scale 2 (trans (1 0 0) (sphere 1))))", "p/vertex/2", (2, 2, 0)),
        ("(p (scale (2 3 4) (box 2 2 2)))", "p/vertex/5", (2, 3, 4)),
        ("(p (rotate (rot-z 90deg) (trans (1 0 0) (sphere 1))))", "p/center", (0, 1, 0)),
        ("(p (transform (pose3 (rot-z 90deg) [0 0 5]) (trans (1 0 0) (sphere 1))))", "p/center", (0, 1, 5)),
        ("(p (trans (list 1 2 3) (sphere 1)))", "p/center", (1, 2, 3)),
        # perse: image coordinates (y/x, z/x), shifted in the image
        ("(p (trans (10 0) (perse (trans (2 1 3) (point tip (0 0 0)) (sphere 1)))))", "p/tip", (10.5, 1.5)),
        # control
        ("(for (i 1 3) ((name i) (trans (i 0 0) (sphere 1))))", "second/center", (2, 0, 0)),
        ("(for (i 2 1) (sphere 1)) (p (sphere 1))", "p/center", (0, 0, 0)),
        ("(if (> k 2) (p (sphere 1)) (p (sphere 2)))", "p/vertex/1", (1, 0, 0)),
        ("(cond ((> k 5) (p (sphere 1))) (else (p (sphere 2))))", "p/vertex/1", (2, 0, 0)),
        ("(let* ((a 1) (b (+ a 1))) (p (trans (a b 0) (sphere 1))))", "p/center", (1, 2, 0)),
        # names of parts
        ("(part sphere (trans (0 1 0) (sphere 1)))", "sphere/center", (0, 1, 0)),
        ("(sphere (trans (0 1 0) (sphere 1)))", "sphere/center", (0, 1, 0)),
        ("(disk (top (sphere 1)))", "disk/top/vertex/1", (1, 0, 0)),
        ("(grid (sphere 1))", "grid/vertex/1", (1, 0, 0)),
        ("(length (sphere 1))", "length/vertex/1", (1, 0, 0)),
        ("(part shifted (sphere 1))", "shifted/vertex/1", (1, 0, 0)),
        ("(part (name 3) (sphere 1))", "third/vertex/1", (1, 0, 0)),
        # surface models
        ("(p ((vertexes (1 (0 0 0)) (2 (1 0 0))) (lines (1 (1 2))) (planes)))", "p/vertex/2", (1, 0, 0)),
        ("(p (vertexes (1 (0 0 1))) (vertexes (2 (0 0 2))))", "p/vertex/2", (0, 0, 2)),
        ("(p (vertexes (for (i 1 3) (i [0 0 i]))))", "p/vertex/3", (0, 0, 3)),
        # functions and variables that give shapes
        ("(p (pair-of 3))", "p/b/vertex/1", (3, 0, 0)),
        ("(p (made 4))", "p/center", (4, 0, 0)),
        ("(let ((s (trans [1 0 0] (sphere 1)))) (p (trans (1 0 0) s)))", "p/center", (2, 0, 0)),
    ],
)
def test_bodies(opened, body, path, expected):
    model = opened(
        f"""
        (defmodel m (k) (declare (array name (first second third))) {body})
        (defmodel shifted () (trans (10 0 0) (sphere 1) (inner (trans (10 0 0) (point mid (0 0 0)) (sphere 1)))))
        (defmodel pair-of (r) (a (sphere 1)) (b (sphere r)))
        (defun made (x) (trans [x 0 0] (sphere 1)))
        """
    )
    np.testing.assert_allclose(model.numbers(f'(feature (m 3) "{path}")'), expected, atol=1e-15)


def test_a_vector_may_be_all_there_is_to_an_argument(opened):
    model = opened("(defmodel stand (v s) (p (trans v s)))")
    np.testing.assert_array_equal(model.numbers("(vertex (stand [1 2 3] (sphere 1)) p 1)"), (2, 2, 3))


def test_names_of_a_model_are_its_own(opened, unknowns):
    model = opened(
        "(defconst c 2) (defmodel m (a) (declare (b (+ a c))) (p (trans (a b 0) (sphere 1))))", **unknowns("b")
    )
    np.testing.assert_array_equal(model.numbers("(origin (m 1) p)"), (1, 3, 0))
    stranger = opened("(defmodel m () (p (trans (b 0 0) (sphere 1))))", **unknowns("b"))
    assert stranger.fault("(m)").code.name == "unknown-name"


def test_optional_and_key_parameters(opened):
    model = opened("(defmodel m (a &optional (b 2) &key (:up c 3)) (p (trans (a b c) (sphere 1))))")
    for call, expected in (("(m 1)", (1, 2, 3)), ("(m 1 5)", (1, 5, 3)), ("(m 1 :up 7)", (1, 2, 7))):
        np.testing.assert_array_equal(model.numbers(f"(origin {call} p)"), expected)


def test_shapes_hold_unknowns(opened, unknowns):
    model = opened("(defmodel m (a th) (p (rotate (0 0 th) (trans (a 0 0) (sphere 1)))))", **unknowns("a", "th"))
    found = model.numbers("(origin (m a th) p)", {"a": 2.0, "th": 0.3})
    np.testing.assert_allclose(found, (2 * np.cos(0.3), 2 * np.sin(0.3), 0), rtol=1e-15)


def test_a_column_that_chooses_a_shape_is_static(opened):
    text = '(defmodel m (k) (if (= k "a") (sphere 1) (sphere 2)))'
    with pytest.raises(StaticColumnNeeded):
        opened(text, k=TextColumn("t", "k")).value("(m k)")
    with pytest.raises(StaticColumnNeeded):
        opened("(defmodel m (k) (if (> k 1) (sphere 1) (sphere 2)))", k=Column("t", "k")).value("(m k)")


def test_the_users_model_comes_before_the_librarys(opened):
    model = opened("(defmodel sphere (r) (point center (r 0 0))) (defmodel m () (p (sphere 2)))")
    np.testing.assert_array_equal(model.numbers("(feature (m) '(p (center)))"), (2, 0, 0))


def test_the_library_keeps_its_own_words(opened):
    model = opened("(defun - (a) 100) (defmodel lambda-free () (sphere 1))")
    np.testing.assert_array_equal(model.numbers("(vertex (sphere 1) 3)"), (-1, 0, 0))


def test_the_tree(opened):
    shape = opened("(defmodel m (r) (p (trans (0 0 r) (sphere r))) (for (i 1 2) (sphere i)))").value("(m 3)")
    assert isinstance(shape.content, ModelCall)
    assert list(shape.content.arguments) == ["r"]
    part, group = shape.content.children
    assert isinstance(part, Part)
    assert isinstance(group, Group)
    (moved,) = part.children
    assert isinstance(moved, Moved)
    assert moved.step.head == "trans"
    assert [type(child) for child in (*moved.children, *group.children)] == [ModelCall] * 3
