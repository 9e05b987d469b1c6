"""Problems of many solves with errors in measured columns, by what is special about them, with their tables."""

from __future__ import annotations

import numpy as np

HEAD = """
(problem corrected
  (data d external {more})
  (unknowns {unknowns})
  (observe d {equation})
  {rest}
  {each})
"""


def text(unknowns, equation, rest="", each="(for-each k)", more=""):
    """A problem of one table, with one of its parts otherwise."""
    return HEAD.format(unknowns=unknowns, equation=equation, rest=rest, each=each, more=more)


def lines(groups=10, rows=12, seed=21, spread=1.0):
    """Points about lines whose slope changes from group to group, in any order, some with fewer; others beside.

    ``spread`` times the errors that are stated: 0.1 in x, 0.2 in y; in z 0.1.
    """
    generator = np.random.default_rng(seed)
    group = np.repeat(np.arange(groups), rows - 3 * (np.arange(groups) % 5 == 2))
    count, slope = len(group), 0.9 + 0.3 * np.sin(0.1 * group)
    x = generator.uniform(0.0, 3.0, count)
    noise = spread * generator.standard_normal((3, count))
    columns = {
        "k": group,
        "t": 0.1 * group,
        "x": x + 0.1 * noise[0],
        "y": 0.2 + slope * x + 0.2 * noise[1],
        "z": slope * np.cos(x) + 0.1 * noise[2],
        "w": x,
        "e": 0.1 * (np.arange(count) % 3 > 0),
        "s": np.full(count, 0.2),
    }
    mixed = generator.permutation(count)
    return {"d": {name: column[mixed] for name, column in columns.items()}}


def circles(groups=10, rows=14, seed=22, gross=0.0, noise=0.02):
    """Points about circles of radius 2 that move, ``gross`` of them half a metre off, with deviations ``s``, ``e``."""
    generator = np.random.default_rng(seed)
    group = np.repeat(np.arange(groups), rows)
    angle = generator.uniform(0, 2 * np.pi, len(group))
    radius = 2.0 + 0.5 * (generator.random(len(group)) < gross)
    x = 1.0 + 0.01 * group + radius * np.cos(angle) + noise * generator.standard_normal(len(group))
    y = -0.5 + radius * np.sin(angle) + noise * generator.standard_normal(len(group))
    deviations = {"s": generator.uniform(0.01, 0.04, len(group)), "e": 0.02 * (np.arange(len(group)) % 2)}
    return {"d": {"k": group, "t": 0.1 * group, "x": x, "y": y, **deviations}}


def marks(groups=12, seed=23, twice=False):
    """Distances from a place to marks, whose positions have errors, once to each (to one of them ``twice``)."""
    generator = np.random.default_rng(seed)
    at = np.column_stack([generator.uniform(0, 10, 9), generator.uniform(0, 10, 9)])
    group, mark = np.repeat(np.arange(groups), 9), np.tile(np.arange(9), groups)
    if twice:
        group, mark = np.append(group, np.arange(groups)), np.append(mark, np.full(groups, 4))
    place = np.column_stack([4 + 0.05 * group, 5 - 0.05 * group])
    wrong = np.tile(0.05 * generator.standard_normal((9, 2)), (1, 1))
    length = np.linalg.norm(at[mark] + wrong[mark] - place, axis=1) + 0.02 * generator.standard_normal(len(group))
    return {
        "marks": {"id": [f"m{i}" for i in range(9)], "x": at[:, 0], "y": at[:, 1]},
        "d": {"k": group, "t": 0.1 * group, "mark": [f"m{i}" for i in mark], "r": length},
    }


def far(groups=12):
    """Circles the last of which have points near their centres, whose corrections take a search."""
    data = circles(groups)["d"]
    lost = (data["k"] >= groups - 3) & (np.arange(len(data["k"])) % 14 == 5)
    middle = {"x": 1.0 + 0.01 * data["k"] + 0.3, "y": np.full(len(lost), -0.45)}
    return {"d": {**data, **{name: np.where(lost, middle[name], data[name]) for name in middle}}}


SLOPE = "(m :init 1) (c :init 0)"
LINE = "(= y (+ c (* m x)))"
BOTH = ":errors ((x 0.1) (y 0.2))"
CIRCLE = "(p (vector 2) :init [0 0]) (r positive :init 1.5)"
RIM = "(= (hypot (- x (p 1)) (- y (p 2))) r)"
EDGE = ":errors ((x 0.02) (y s))"
TWO = "[(+ c (* m x)) (* m (cos x))]"
MARKS = "(= r (distance p [marks.x marks.y])) :errors ((marks.x 0.05) (marks.y 0.05)) :sigma 0.02"
SLIDE = "(window t :length 0.25 :step 0.1 :min-rows 4)"
KEYED = "(data marks external :key id)"


def joined(data_text):
    """The problem of the marks, whose table comes first."""
    made = text("(p (vector 2) :init [4 5])", MARKS, more=":with (marks mark)", each=data_text)
    return made.replace("(data d", f"{KEYED} (data d", 1)


PROBLEMS = {
    "a line": (text(SLOPE, f"{LINE} {BOTH}"), lines()),
    "a line without a start": (text("(m) (c)", f"{LINE} {BOTH}"), lines()),
    "a line, derived": (text(SLOPE, f"{LINE} {BOTH}", "(derive (at2 (+ c (* 2 m))) (zero (/ (- c) m)))"), lines()),
    "a line from afar": (text("(m :init -20) (c :init 300)", f"{LINE} {BOTH}"), lines()),
    "some rows": (text(SLOPE, f"{LINE} {BOTH} :when (> w 0.4)"), lines()),
    "some values exact": (text(SLOPE, f"{LINE} :errors ((x e) (y 0.2))"), lines()),
    "noise that is too large": (text(SLOPE, f"{LINE} {BOTH}"), lines(spread=4.0)),
    "two exact equations": (
        text(SLOPE, f"{LINE} (= z (* m (cos x))) :errors ((x 0.1) (y 0.2) (z 0.1))"),
        lines(),
    ),
    "a covariance": (
        text(SLOPE, f"(= [y z] {TWO}) :covariance [[0.04 0.01] [0.01 0.02]] :errors ((x 0.1) (y 0.2))"),
        lines(),
    ),
    "more equations than values": (text(SLOPE, f"(= [y z] {TWO}) :sigma 0.2 :errors ((x 0.1))"), lines()),
    "beside others": (
        text(SLOPE, f"{LINE} {BOTH}", "(observe d (= z (* m (cos w))) :sigma 0.1)"),
        lines(),
    ),
    "used twice": (
        text(SLOPE, f"{LINE} {BOTH}", "(observe d (= z (* m (cos x))) :sigma 0.1 :errors ((x 0.1)))"),
        lines(),
    ),
    "beside unknown noise": (
        text(SLOPE, f"{LINE} {BOTH}", "(observe d (= z (* m (cos w))) :sigma unknown)"),
        lines(),
    ),
    "a curve beside unknown noise": (
        text(
            SLOPE,
            f"(= y (+ c (exp (* 0.5 m x)))) {BOTH}",
            "(observe d (= z (sin (* m (+ 1 (cos w))))) :sigma unknown)",
        ),
        lines(),
    ),
    "a prior and a bound": (
        text("(m :init 0.5 :in [0 1.1]) (c :init 0)", f"{LINE} {BOTH}", "(constraints (normal c 0.2 0.1))"),
        lines(30),  # of fewer most are pushed against the bound
    ),
    "an equation beside": (text(SLOPE, f"{LINE} {BOTH}", "(constraints (= (+ c (* 2 m)) 2))"), lines()),
    "an inequality": (text(SLOPE, f"{LINE} {BOTH}", "(constraints (<= m 0.9))"), lines()),
    "a circle": (text(CIRCLE, f"{RIM} {EDGE}"), circles()),
    "a circle, noise of its own": (text(CIRCLE, f"{RIM} {EDGE} :sigma 0.02"), circles()),
    "a circle, noise of some": (text(CIRCLE, f"{RIM} {EDGE} :sigma e"), circles()),
    "a circle, a loss": (text(CIRCLE, f"{RIM} {EDGE} :loss (huber 1.3)"), circles(gross=0.1)),
    "a circle, a loss that is not convex": (text(CIRCLE, f"{RIM} {EDGE} :loss cauchy"), circles(10, gross=0.1)),
    "a circle, consensus": (text(CIRCLE, f"{RIM} {EDGE}", "(solve :robust lmeds)"), circles(12, gross=0.1)),
    "points at the centre": (text(CIRCLE, f"{RIM} {EDGE}"), far()),
    "marks of all solves": (joined("(for-each k)"), marks()),
    "marks seen twice": (joined("(for-each k)"), marks(twice=True)),
    "windows": (text(SLOPE, f"{LINE} {BOTH}", each=SLIDE), lines()),
    "windows without a start": (text("(m) (c)", f"{LINE} {BOTH}", each=SLIDE), lines()),
    "windows of circles": (text(CIRCLE, f"{RIM} {EDGE}", each=SLIDE), circles()),
    "windows and the centre": (text(CIRCLE, f"{RIM} {EDGE}", each=SLIDE), far()),
    "a line for each group": (
        text(SLOPE.replace("c :init", "c :per d.g :init"), "(= y (+ (c g) (* m x))) " + BOTH),
        {"d": {**lines()["d"], "g": np.arange(len(lines()["d"]["k"])) % 2}},
    ),
}
