"""Every fault of models and paths: code, place, hint."""

from __future__ import annotations

import pytest

from mbm.expression.nodes import Component
from mbm.language.scope import LocalScope
from mbm.shapes import faults
from mbm.text.types import Code

BODY = [
    # code, body of (defmodel m (k) …), blamed text, part of the message or hint
    ("not-a-shape", "(trans (0 0 1) 5)", "5", "a number"),
    ("not-a-shape", "k", "k", "a number (`k`)"),
    ("not-a-shape", "nobody", "nobody", "the name `nobody`"),
    ("not-a-shape", "[1 2 3]", "[1 2 3]", "list of numbers"),
    ("not-a-shape", '(p "box")', '"box"', "a text"),
    ("not-a-shape", "(cylindr k 2)", "k", "did you mean `cylinder`?"),
    ("not-a-shape", "(tran (0 0 1) (sphere 1))", "(0 0 1)", "did you mean `trans`?"),
    ("not-a-shape", "(p)", "(p)", "holds no shape"),
    ("not-a-shape", "(cylinder)", "(cylinder)", "holds no shape"),
    ("not-a-shape", "(helper 2)", "(helper 2)", "a number"),
    ("not-a-shape", "(declare (a (list 1 2))) (a)", "(a)", "a list of 2"),
    ("duplicate-part", "(p (sphere 1)) (p (sphere 2))", "p", "already"),
    ("duplicate-part", "(for (i 1 2) (p (sphere i)))", "p", "array"),
    ("duplicate-part", "(p (sphere 1)) (point p (0 0 0))", "p", "already"),
    ("duplicate-number", "(vertexes (1 (0 0 0)) (1 (1 0 0)))", "1", "vertex 1"),
    ("duplicate-number", "(vertexes (1 (0 0 0)) (2 (1 0 0))) (lines (1 (1 2)) (1 (2 1)))", "1", "line 1"),
    ("unknown-vertex", "(vertexes (1 (0 0 0)) (2 (1 0 0))) (lines (1 (1 3)))", "3", "1, 2"),
    ("unknown-vertex", "(vertexes (1 (0 0 0)) (2 (1 0 0))) (planes (1 (1 2 7)))", "7", "no vertex 7"),
    ("bad-constraint", "(constraints (normel k 1 2)) (sphere 1)", "normel", "did you mean `normal`?"),
    ("bad-constraint", "(constraints (normal k 1)) (sphere 1)", "(normal k 1)", "at least 3"),
    ("bad-constraint", "(constraints k) (sphere 1)", "k", "type in front"),
    ("bad-form", "(sphere 1) (declare (a 1))", "(declare (a 1))", "before the shapes"),
    ("bad-form", "(declare (a 1 2)) (sphere 1)", "(a 1 2)", "declaration"),
    ("bad-form", "(declare (a 1))", "m", "no shape"),
    ("bad-form", "(for (i 1) (sphere 1))", "(i 1)", "counter"),
    ("bad-form", "(for (i 1 2))", "(for (i 1 2))", "not complete"),
    ("bad-form", "(lines (1 (1 2)))", "(lines (1 (1 2)))", "no vertexes"),
    ("bad-form", "(vertexes (1 0 0 0))", "(1 0 0 0)", "an entry"),
    ("bad-form", "(vertexes (1 (0 0 0))) (lines (1 (1 1 1)))", "(1 1 1)", "given by 2"),
    ("bad-form", "(vertexes (1 (0 0 0))) (planes (1 (1 1)))", "(1 1)", "at least 3"),
    ("bad-form", "(trans (0 0 1))", "(trans (0 0 1))", "not complete"),
    ("bad-form", "(or)", "(or)", "not complete"),
    ("bad-form", "(perse)", "(perse)", "not complete"),
    ("bad-form", "(point foot)", "(point foot)", "not complete"),
    ("bad-form", "(part foot)", "(part foot)", "not complete"),
    ("bad-form", "(part 3 (sphere 1))", "3", "name of a part"),
    ("length-clash", "(trans (1 2) (sphere 1))", "(1 2)", "length 3"),
    ("length-clash", "(rotate (rot2 1) (sphere 1))", "(rot2 1)", "3 coordinates"),
    ("wrong-kind", "(rotate k (sphere 1))", "k", "vector of length 3"),
    ("not-static", "(for (i 1 u) (sphere 1))", "u", "unknown"),
    ("not-static", "(if (> u 0) (sphere 1) (sphere 2))", "(> u 0)", "unknown"),
    ("bad-profile", "(extrude (box 1 1 1) 2)", "(box 1 1 1)", "z = 0"),
    ("bad-profile", "(extrude (trans (0 0 1) (rectangular 1 1)) 2)", "(trans (0 0 1) (rectangular 1 1))", "z = 0"),
    ("bad-profile", "(extrude (polyline ((0 0 1) (1 0 0))) 2)", "(polyline ((0 0 1) (1 0 0)))", "z = 0"),
    ("bad-profile", "(extrude (p (rectangular 1 1)) 2)", "(p (rectangular 1 1))", "the part `p`"),
    (
        "bad-profile",
        "(extrude (or (rectangular 1 1) (rectangular 2 2)) 2)",
        "(or (rectangular 1 1) (rectangular 2 2))",
        "2 surfaces",
    ),
    ("bad-profile", "(extrude (extrude (disk 1) 2) 2)", "(extrude (disk 1) 2)", "z = 0"),
    ("bad-profile", "(extrude (point a (0 0 0)) 2)", "(point a (0 0 0))", "neither"),
    (
        "bad-profile",
        "(extrude (scale (-1 1 1) (rectangular 1 1)) 2)",
        "(scale (-1 1 1) (rectangular 1 1))",
        "clockwise",
    ),
    ("wrong-arity", "(extrude (rectangular 1 1))", "(extrude (rectangular 1 1))", "(extrude PROFILE length)"),
    ("wrong-kind", "(extrude (rectangular 1 1) -2)", "-2", "a positive length"),
    ("wrong-kind", "(revolve (rectangular 1 1) 400deg)", "400deg", "up to 360deg"),
    ("wrong-kind", "(sweep (rectangular 1 1) 2)", "2", "a curve"),
    ("not-a-shape", "(extrude 5 2)", "5", "a number"),
    ("wrong-arity", "(other)", "(other)", "no arguments"),
    ("unknown-name", "(p (trans (0 0 hight) (sphere 1)))", "hight", None),
]


@pytest.mark.parametrize(("code", "body", "blamed", "words"), BODY, ids=[f"{c}-{b[:30]}" for c, b, _, _ in BODY])
def test_bodies(opened, code, body, blamed, words):
    text = f"(defmodel m (k u) {body})\n(defmodel other (a) (sphere a))\n(defun helper (a) a)"
    fault = opened(text, u=Component("u")).fault("(m 2 u)")
    assert fault.code.name == code, fault.message
    assert fault.place.text == blamed
    if words is not None:
        assert words in f"{fault.message} | {fault.hint}"


ROOM = """
(defmodel desk (x) (board (trans (0 0 1) (rectangular x 1)))
  (declared (sphere 1)) (two (sphere 1) (sphere 2)) (twins (leg-of) (leg-of)))
(defmodel bent () (polyline ((0 0) (1 1))) (trans (0 0 1) (curve (s 0 1) [s s])))
(defmodel leg-of () (leg (sphere 1)))
(defmodel seen () (perse (trans (5 0 0) (sphere 1))))
(defmodel named () (declare (array leg (front 7))) ((leg 1) (sphere 1)))
"""
PATHS = [
    ("unknown-part", "(vertex (desk 1) bord 1)", "bord", "did you mean `board`?"),
    ("unknown-part", "(vertex (desk 1) board top 1)", "top", "it has no parts"),
    ("unknown-part", "(vertex (desk 1) garage 1)", "garage", "`board`, `declared`"),
    ("unknown-part", '(vertex (desk 1) "garage" 1)', '"garage"', "no part `garage`"),
    ("unknown-part", '(feature (desk 1) "garage/vertex/1/2")', '"garage/vertex/1/2"', "no part `garage`"),
    ("unknown-feature", '(feature (desk 1) "board/vertexx/1")', '"board/vertexx/1"', "did you mean `vertex`?"),
    ("unknown-feature", "(feature (desk 1) '(board (middle)))", "middle", "vertex 1…4, line 1…4, plane 1, 2, origin"),
    ("unknown-feature", "(feature (desk 1) '(declared (centre)))", "centre", "did you mean `center`?"),
    ("unknown-feature", "(vertex (desk 1) board 5)", "5", "1…4"),
    ("unknown-feature", "(plane (desk 1) two 1)", "1", "no plane at all"),
    ("unknown-feature", "(vertex (desk 1) 1)", "1", "no vertex at all"),
    ("ambiguous-feature", "(vertex (desk 1) two 1)", "1", "more than one vertex 1"),
    ("ambiguous-feature", '(feature (desk 1) "two/center")', '"two/center"', "more than one point `center`"),
    ("ambiguous-feature", "(vertex (desk 1) twins leg 1)", "leg", "more than one part `leg`"),
    ("ambiguous-part", "(vertex (desk 1) declared 1)", "declared", "quote the path"),
    ("bad-path", '(feature (desk 1) "board")', '"board"', "ends at the part"),
    ("bad-path", "(feature (desk 1) '(board (vertex)))", "vertex", "wants a number"),
    ("bad-path", '(feature (desk 1) "board//1")', '"board//1"', "empty piece"),
    ("bad-path", '(feature (desk 1) "")', '""', "empty"),
    ("bad-path", "(feature (desk 1) '())", "()", "neither"),
    ("bad-path", "(feature (desk 1) '(board (:up 1)))", ":up", "neither"),
    ("bad-path", "(feature (desk 1) '(3 (vertex 1)))", "3", "does not follow"),
    ("bad-path", "(vertex (desk 1) 2 1)", "2", "numbers stand last"),
    ("bad-path", "(origin (desk 1) (legs 2))", "(legs 2)", "declares no array"),
    ("bad-path", "(get-vertex-from-model '(desk 1) '(board (line 1)))", "1", "leads to a line"),
    ("bad-index", "(origin (named) (leg 3))", "(leg 3)", "outside 1 … 2"),
    ("wrong-kind", "(vertex 3 1)", "3", "a model with its arguments"),
    ("wrong-kind", '(feature [1 2 3] "origin")', "[1 2 3]", "a model with its arguments"),
    ("wrong-kind", "(vertex (desk 1) board 1.5)", "1.5", "number of a feature"),
    ("wrong-kind", "(get-vertex-from-model 3 '(board (vertex 1)))", "3", "quoted"),
    ("wrong-kind", "(norm (line (desk 1) board 1))", "(line (desk 1) board 1)", "a line"),
    ("unknown-name", "(get-vertex-from-model '(dsk 1) '(board (vertex 1)))", "dsk", "did you mean `desk`?"),
    ("damaged-mesh", '(vertex (mesh "part.step") 1)', '"part.step"', ".stl .obj .ply"),
    ("wrong-arity", "(vertex (desk 1))", "(vertex (desk 1))", "usage"),
    ("not-static", "(vertex (desk 1) board u)", "u", "unknown"),
    ("unknown-feature", '(feature (desk 1) "board/curve/1")', '"board/curve/1"', "it has no curve at all"),
    ("bad-path", '(feature (desk 1) "board/curve")', '"board/curve"', "wants a number"),
    ("unknown-feature", '(feature (bent) "curve/3")', '"curve/3"', "its curve numbers: 1, 2"),
    ("unknown-feature", '(feature (bent) "curved/1")', '"curved/1"', "did you mean `curve`?"),
    ("bad-path", "(get-vertex-from-model '(bent) '(curve 1))", "1", "leads to a curve"),
    ("not-available-yet", '(feature (desk 1) "board/silhouette")', '"board/silhouette"', "silhouettes"),
    ("no-faces", "(perse (bent))", "(perse (bent))", "no silhouette"),
    ("already-projected", "(perse (seen))", "(perse (seen))", "out of the model"),
]


@pytest.mark.parametrize(("code", "form", "blamed", "words"), PATHS, ids=[f"{c}-{f}" for c, f, _, _ in PATHS])
def test_paths(opened, code, form, blamed, words):
    fault = opened(ROOM, u=Component("u"), declared=Component("declared")).fault(form)
    assert fault.code.name == code, fault.message
    assert fault.place.text == blamed
    assert words in f"{fault.message} | {fault.hint}"


def test_every_code_is_tried():
    tried = {case[0] for case in (*BODY, *PATHS)}
    assert {code.name for code in vars(faults).values() if isinstance(code, Code)} <= tried


RUNAWAYS = [
    ("list-too-long", "(defmodel m (a) (for (i 1 1000000000) (sphere 1)))", "(m 1)"),
    ("list-too-long", "(defmodel m (a) (vertexes (for (i 1 1000000000) (i (0 0 0)))))", "(m 1)"),
    (
        "too-many-steps",
        "(defmodel m (a) (for (i 1 100000) (for (j 1 100000) (if false (sphere 1) (or (sphere 1))))))",
        "(m 1)",
    ),
    ("too-deep", "(defmodel m (a) (p (trans (a 0 0) (m (+ a 1)))))", "(m 1)"),
    ("too-deep", "(defmodel m (a) (n a)) (defmodel n (a) (m a))", "(m 1)"),
    # a tree of 2^60 leaves that shares its branches: walking it is what must end
    ("too-many-steps", "(defmodel m (a) (if (> a 0) (or (m (- a 1)) (m (- a 1))) (sphere 1)))", "(vertex (m 60) p 1)"),
]


@pytest.mark.parametrize(("code", "text", "form"), RUNAWAYS)
def test_runaways_end(opened, code, text, form):
    assert opened(text).fault(form).code.name == code


def test_faults_name_the_call_that_led_there(opened):
    fault = opened("(defmodel m (a) (trans (a 0) (sphere 1)))\n(defmodel n (a) (m a))").fault("(n 1)")
    assert [label.place.text for label in fault.labels] == ["(m a)", "(n 1)"]


def test_a_quoted_path_is_no_place_for_variables(opened):
    room = opened(ROOM)
    room.scope = LocalScope({"board": Component("board")}, room.scope)
    assert room.numbers("(feature (desk 1) '(board (vertex 1)))").tolist() == [1, 1, 1]
