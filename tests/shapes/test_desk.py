"""The desk of Oyama & Tachi 1989 in both readings, and its features as values."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.expression.nodes import Column
from mbm.language.values import StaticColumnNeeded, TextColumn
from mbm.text.types import Symbol

MODEL = "(desk 60cm 35cm 2.5cm 70cm)"
EXACT = {"rtol": 1e-15, "atol": 1e-16}  # a few additions of doubles


@pytest.mark.parametrize(
    ("reading", "x2", "y2"),
    # literal: 0.6/2 − 0.03, 0.35/2 − 0.03; fixed: 0.6 − 0.03, 0.35 − 0.03
    [("literal", 0.27, 0.145), ("fixed", 0.57, 0.32)],
)
def test_board_and_legs(opened, desk_text, reading, x2, y2):
    desk = opened(desk_text[reading])
    board = [desk.numbers(f"(vertex {MODEL} board {n})") for n in range(1, 5)]
    np.testing.assert_allclose(
        board, [(0.6, 0.35, 0.7), (-0.6, 0.35, 0.7), (-0.6, -0.35, 0.7), (0.6, -0.35, 0.7)], **EXACT
    )
    feet = [desk.numbers(f"(origin {MODEL} leg{n})") for n in range(1, 5)]
    np.testing.assert_allclose(feet, [(x2, y2, 0), (-x2, y2, 0), (-x2, -y2, 0), (x2, -y2, 0)], rtol=1e-14)


@pytest.mark.parametrize(
    ("form", "expected"),
    [
        (f"(feature {MODEL} '(desk (board (vertex 1))))", (0.6, 0.35, 0.7)),
        (f"(feature {MODEL} '(board (vertex 1)))", (0.6, 0.35, 0.7)),
        (f'(feature {MODEL} "board/vertex/1")', (0.6, 0.35, 0.7)),
        (f'(feature {MODEL} "desk/board/vertex/1")', (0.6, 0.35, 0.7)),
        (f"(feature {MODEL} '(board vertex 1))", (0.6, 0.35, 0.7)),
        (f"(feature {MODEL} '((leg 1) (origin)))", (0.57, 0.32, 0)),
        (f'(feature {MODEL} "leg1/origin")', (0.57, 0.32, 0)),
        (f"(origin {MODEL} (leg 1))", (0.57, 0.32, 0)),
        (f'(origin {MODEL} "leg1")', (0.57, 0.32, 0)),
        (f"(origin {MODEL} board)", (0, 0, 0.7)),
        (f"(origin {MODEL})", (0, 0, 0)),
        (f'(feature {MODEL} "origin")', (0, 0, 0)),
        (f'(feature {MODEL} "leg1/top")', (0.57, 0.32, 0.7)),
        (f"(origin (trans [1 2 3] {MODEL}))", (1, 2, 3)),
        (f"(vertex (trans [1 2 3] {MODEL}) board 1)", (1.6, 2.35, 3.7)),
        (f"(trans [1 2 3] (vertex {MODEL} board 1))", (1.6, 2.35, 3.7)),
        (f"(- (vertex {MODEL} board 1) (vertex {MODEL} board 3))", (1.2, 0.7, 0)),
        (f"(let ((d {MODEL})) (vertex d board 1))", (0.6, 0.35, 0.7)),
        ("(vertex '(desk 60cm 35cm 2.5cm 70cm) board 1)", (0.6, 0.35, 0.7)),
        ("(origin (desk 60cm 35cm 2.5cm 70cm 10cm) leg1)", (0.5, 0.32, 0)),
    ],
)
def test_ways_to_name_a_point(opened, desk_text, form, expected):
    np.testing.assert_allclose(opened(desk_text["fixed"]).numbers(form), expected, rtol=1e-14)


def test_lines_planes_and_axes(opened, desk_text):
    desk = opened(desk_text["fixed"])
    # generator 3 of a leg stands at its -x side
    expected = [(-0.595, 0.32, 0), (-0.595, 0.32, 0.7)]
    np.testing.assert_allclose(desk.numbers(f"(line {MODEL} leg2 3)"), expected, rtol=1e-14)
    np.testing.assert_allclose(desk.numbers(f"(feature {MODEL} '(desk (leg2 (line 3))))"), expected, rtol=1e-14)
    np.testing.assert_allclose(desk.numbers(f"(plane {MODEL} board 1)")[:, 2], 0.7)
    np.testing.assert_allclose(desk.numbers(f"(axis {MODEL} leg1)"), [(0.57, 0.32, 0), (0.57, 0.32, 1)], rtol=1e-14)
    turned = desk.numbers(f"(rotate [0 0 90deg] (line {MODEL} leg2 3))")
    np.testing.assert_allclose(turned, [(-0.32, -0.595, 0), (-0.32, -0.595, 0.7)], rtol=1e-14, atol=1e-15)


def test_an_element_of_a_vertex(opened, desk_text):
    desk = opened(desk_text["fixed"])
    assert desk.wanted(f"((vertex {MODEL} board 1) 3)").value == pytest.approx(0.7, rel=1e-15)  # 70 × 0.01


def test_columns_of_parts_numbers_and_paths_are_static(opened, desk_text):
    columns = {
        "part": TextColumn("corners", "part"),
        "path": TextColumn("corners", "path"),
        "n": Column("corners", "n"),
    }
    desk = opened(desk_text["fixed"], **columns)
    for form, column in (
        (f"(vertex {MODEL} part 1)", "part"),
        (f"(vertex {MODEL} board n)", "n"),
        (f"(feature {MODEL} path)", "path"),
        (f"(feature {MODEL} '(board (vertex n)))", "n"),
    ):
        with pytest.raises(StaticColumnNeeded) as needed:
            desk.value(form)
        assert needed.value.column is columns[column] or needed.value.column.name == column


def test_variables_that_hold_names(opened, desk_text):
    desk = opened(desk_text["fixed"] + "(defun foot (which) (origin (desk 60cm 35cm 2.5cm 70cm) which))")
    for argument in ("'leg3", '"leg3"'):
        np.testing.assert_allclose(desk.numbers(f"(foot {argument})"), (-0.57, -0.32, 0), rtol=1e-14)


def test_a_user_may_take_the_names_of_feature_functions(opened):
    line = opened("(defun line (a b x) (+ a (* b x)))")
    assert line.value("(line 1 2 3)").value == 7


def test_equal_arguments_give_one_shape(opened, desk_text, unknowns):
    desk = opened(desk_text["fixed"], **unknowns("x", "y"))
    assert desk.value("(desk x (+ y 1) 1 1)") is desk.value("(desk x (+ y 1) 1 1 0.03)")
    assert desk.value("(desk x y 1 1)") is not desk.value("(desk y x 1 1)")
    assert [call.name for call in desk.log.calls] == ["desk"] * 3


def test_array_elements_are_symbols(opened, desk_text):
    shape = opened(desk_text["fixed"]).value(MODEL)
    names = [item.name for item in shape.content.arrays["leg"].items if isinstance(item, Symbol)]
    assert names == ["leg1", "leg2", "leg3", "leg4"]
