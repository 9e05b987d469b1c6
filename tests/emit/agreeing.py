"""Small problems whose measurements have to agree first: consensus, bounded losses, noise that goes with a loss.

All but one have data with gross errors; each has other data of the same kind, with errors elsewhere, for a solver that
was made with the first.
"""

from __future__ import annotations

LINE = "(0 1.1) (1 2.9) (2 5.2) (3 6.8) (4 9.1) (5 17.0) (6 13.2) (7 14.9)"
OTHER_LINE = "(0 1.2) (1 7.9) (2 5.1) (3 6.9) (4 8.8) (5 11.0) (6 13.1) (7 15.2)"
MASTS = """(data masts
        (table (id x y) ("a" 0 10) ("b" 10 0) ("c" -10 1) ("d" 3 -9) ("e" 7 8) ("f" -6 -7)) :key id)"""

TEXTS = {
    "bounded": """(problem bounded "Bounded losses; noise with a loss and noise without."
      (data d (table (x y) {rows}))
      (data e (table (u) (1.2) (0.7) (1.3) (0.8) (1.1)))
      (unknowns (a :init 1) (b :init 1))
      (observe d (= y (+ (* a x) b)) :sigma (unknown 0.2) :loss geman-mcclure)
      (observe e (= u b) :sigma unknown))""",
    "lossy-noise": """(problem lossy-noise "The noise of all rows is unknown, and there is a loss."
      (data d (table (x y) {rows}))
      (unknowns (a :init 1) (b :init 1))
      (observe d (= y (+ (* a x) b)) :sigma unknown :loss tukey))""",
    "exhausted": """(problem exhausted "A loss that ends keeps two points of three: a line without residuals."
      (data d (table (x y) {rows}))
      (unknowns (a :init 1) (b :init 1))
      (observe d (= y (+ (* a x) b)) :sigma 0.1 :loss tukey))""",
    "startless": f"""(problem startless "Places from ranges, one of them wrong, epoch by epoch; no start is stated."
      {MASTS}
      (data ranges (table (epoch mast r) {{rows}}) :with (masts mast))
      (unknowns (p (vector 2)))
      (observe ranges (= r (distance p [masts.x masts.y])) :sigma 5cm)
      (for-each epoch)
      (solve :robust lmeds))""",
    "unstarted": f"""(problem unstarted "Places from good ranges, epoch by epoch: consensus gives the starts alone."
      {MASTS}
      (data ranges (table (epoch mast r) {{rows}}) :with (masts mast))
      (unknowns (p (vector 2)))
      (observe ranges (= r (distance p [masts.x masts.y])) :sigma unknown)
      (for-each epoch))""",
    "offset": f"""(problem offset "A place and an offset, with unknown noise."
      {MASTS}
      (data ranges (table (mast r) {{rows}}) :with (masts mast))
      (unknowns (p (vector 2) :init [1 1]) (o :init 0))
      (observe ranges (= r (+ o (distance p [masts.x masts.y]))) :sigma unknown)
      (solve :robust (ransac :trials 30)))""",
    "sights": """(problem sights "Where a camera stands, from points; one was mistaken for another."
      (data d (table (x y z u v) {rows}))
      (camera cam :focal (1 1) :center (0 0))
      (unknowns (T (pose 3)))
      (observe d (= [u v] (project cam (transform T [x y z]))) :sigma 0.002)
      (solve :robust lmeds))""",
    "limited": """(problem limited "A parabola with a prior, and a stated limit."
      (data d (table (x y) {rows}))
      (unknowns (a :init 1) (b :init 1) (q :init 0 :sigma 0.1))
      (observe d (= y (+ (* a x) b (* q (* x x)))) :sigma 0.2)
      (solve :robust (msac :threshold 2.5)))""",
    "graduated": """(problem graduated "Two groups, one of unknown noise, by graduated non-convexity."
      (data d (table (x y) {rows}))
      (data e (table (u) (1.2) (0.7) (1.3) (0.8) (4)))
      (unknowns (a :init 1) (b :init 1))
      (observe d (= y (+ (* a x) b)) :sigma unknown)
      (observe e (= u b) :sigma 0.3)
      (solve :robust gnc))""",
    "both": """(problem both "Consensus and a loss, each with unknown noise."
      (data d (table (x y) {rows}))
      (data e (table (u) (1.2) (0.7) (1.3) (0.8) (4)))
      (unknowns (a :init 1) (b :init 1 :in (0 3)))
      (observe d (= y (+ (* a x) b)) :sigma (unknown 0.2) :loss cauchy)
      (observe e (= u b) :sigma unknown)
      (solve :robust lmeds))""",
    "held": """(problem held "Consensus about a parabola that goes through a point."
      (data d (table (x y) {rows}))
      (unknowns (a :init 1) (b :init 1) (c :init 0))
      (observe d (= y (+ (* a x) b (* c (* x x)))) :sigma 0.2)
      (constraints (= (+ a b) 3))
      (solve :robust lmeds))""",
    "at-a-bound": """(problem at-a-bound "The noise of rows with a loss, where a bound holds the fit."
      (data d (table (x y) {rows}))
      (unknowns (a :init 1) (b :init 2 :in (1.5 3)))
      (observe d (= y (+ (* a x) b)) :sigma unknown :loss tukey))""",
    "at-limits": """(problem at-limits "Consensus about a parabola that a bound and an inequality hold."
      (data d (table (x y) {rows}))
      (unknowns (a :init 1) (b :init 2 :in (1.4 3)) (c :init 0))
      (observe d (= y (+ (* a x) b (* c (* x x)))) :sigma unknown)
      (constraints (>= c 0.04))
      (solve :robust lmeds))""",
    "levelling": """(problem levelling "Heights of marks; one step is wrong."
      (data marks (table (id height known) ("a" 10 1) ("b" 11 0) ("c" 12 0)) :key id)
      (data steps (table (from to rise) {rows}))
      (unknowns (h :per marks :init height :fixed (= known 1) :unit m))
      (observe steps (= rise (- (h to) (h from))) :sigma 1cm)
      (solve :robust lmeds))""",
    "matrices": """(problem matrices "A point that moves, each place with a covariance matrix; one is wrong."
      (data d (table (t u v s c) {rows}))
      (unknowns (p (vector 2) :init [0 0]) (w (vector 2) :init [1 1]))
      (observe d (= [u v] [(+ (p 1) (* t (w 1))) (+ (p 2) (* t (w 2)))]) :covariance [[s c] [c (* 2 s)]])
      (solve :robust (msac :trials 40)))""",
}
_FIRST = '("a" 8.080) ("b" 9.261) ("c" 14.062) ("d" 11.115) ("e" 8.531) ("f" 11.424)'
_SECOND = '("a" 9.229) ("b" 12.015) ("c" 7.979) ("d" 11.058) ("e" 9.492) ("f" 9.001)'
_THIRD = '("a" 17.112) ("b" 9.835) ("c" 11.257) ("d" 6.472) ("e" 12.754) ("f" 7.621)'
_GOOD = '("a" 8.080) ("b" 9.261) ("c" 11.062) ("d" 11.115) ("e" 8.531) ("f" 11.424)'
_BETTER = '("a" 9.229) ("b" 12.015) ("c" 7.979) ("d" 11.058) ("e" 11.492) ("f" 9.001)'


def _epochs(*epochs: str) -> str:
    return " ".join(epoch.replace("(", f"({number} ") for number, epoch in enumerate(epochs, start=1))


ROWS = {
    "exhausted": ("(0 1.1) (1 2.9) (2 9.0)", "(0 1.2) (1 2.9) (2 9.0)"),
    "startless": (_epochs(_FIRST, _SECOND, _THIRD), _epochs(_THIRD, _FIRST)),
    "unstarted": (_epochs(_GOOD, _BETTER), _epochs(_BETTER, _GOOD)),
    "offset": (_FIRST, _SECOND),
    "sights": (
        """(0.02 0.9 -0.71 -0.0358 0.2258) (0.9 -0.38 -0.15 0.2768 -0.0699) (0.66 -0.18 0.1 0.3872 -0.1984)
        (-0.94 0.51 0.08 -0.2312 -0.0036) (-0.34 0.58 -0.39 -0.1019 0.0933) (-0.09 -0.73 -0.19 0.0690 -0.2353)
        (-0.59 -0.48 0.5 -0.0818 -0.2163) (-0.44 -0.03 0.96 -0.0765 -0.1135)""",
        """(-0.48 -0.4 0.63 -0.0863 -0.0498) (-0.82 0.2 0.46 -0.1685 0.0330) (-0.62 -0.89 -0.45 -0.1737 -0.1974)
        (0.31 0.12 -0.7 -0.0535 0.0437) (-0.13 0.34 -0.15 -0.1077 0.0813) (0.27 0.93 0.37 0.1739 0.0624)
        (-0.22 -0.63 -0.31 -0.0961 -0.1216) (0.02 0.78 0.55 -0.0552 0.1702)""",
    ),
    "levelling": (
        """("a" "b" 1.21) ("b" "c" 0.83) ("a" "c" 2.06) ("c" "b" -0.84) ("a" "b" 1.6) ("c" "a" -2.05)
        ("a" "b" 1.22)""",
        """("a" "b" 1.21) ("b" "c" 0.83) ("a" "c" 3.06) ("c" "b" -0.84) ("a" "b" 1.22) ("c" "a" -2.05)
        ("a" "b" 1.22) ("c" "b" -0.86)""",
    ),
    "matrices": (
        """(0 1.0 2.1 0.04 0.01) (1 1.9 4.2 0.05 -0.02) (2 3.1 6.0 0.09 0.03) (3 9 8 0.04 0.01)
        (4 5.1 9.8 0.05 0.01) (5 6 12.1 0.05 0.0)""",
        """(0 1.0 2.1 0.04 0.01) (1 1.9 4.2 0.05 -0.02) (2 3.1 6.0 0.09 0.03) (3 4 8 0.04 0.01)
        (4 1.1 9.8 0.05 0.01) (5 6 12.1 0.05 0.0)""",
    ),
}
"""The rows of a problem, and other ones; those without have `LINE` and `OTHER_LINE`."""


def with_rows(name: str, other: int) -> str:
    """The text of a problem with its rows (``other`` 0) or with the other ones (1)."""
    return TEXTS[name].format(rows=ROWS.get(name, (LINE, OTHER_LINE))[other])


AGREEING = {name: with_rows(name, 0) for name in TEXTS}
