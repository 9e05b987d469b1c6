"""Problems of many solves with families, by what is special about them."""

from __future__ import annotations

import numpy as np

SHARED = """
(problem shared
  (data anchors (table (x z) (0 1.02) (1 1.31) (2 1.58) (3 1.92)))
  (data d external)
  (unknowns (a :init 0) (b :init 0))
  (observe anchors (= z (+ a (* b x))) :sigma {anchored})
  (observe d (= y (+ a (* b x))) :sigma {sigma})
  {more}
  {each})
"""
BIASES = """
(problem biases
  (data d external)
  (unknowns (v :init 0) (b :per d.group :init 0))
  (observe d {when} (= y (+ (* v x) (b group))) :sigma {sigma})
  {more}
  (for-each epoch))
"""
LEVELLING = """
(problem levelling
  (data points external :key point)
  (data lines external)
  (unknowns (h :per points :init {init} {fixed}))
  (observe lines (= dh (- (h to) (h from))) :sigma {sigma})
  {more}
  (for-each campaign))
"""
POSES = """
(problem poses
  (data d external)
  (unknowns (T (pose 3) :per d.image :init (pose3 (rot-z 0deg) [0 0 0])))
  (camera cam :model pinhole :focal 500 :center (0 0) :axes opencv)
  (observe d (= [u v] (project cam (transform (T image) [x y z]))) :sigma 1)
  (for-each session))
"""
OWN = """
(problem own
  (data stations external :key station)
  (data d external)
  (unknowns (o :per stations :init guess {limits}) (slope :init 0))
  (observe d (= y (* (exp (* slope x)) (o station))) :sigma 0.05)
  (for-each day))
"""


def biases(count=40, unequal=False, seed=3):
    """Lines with a slope and an offset for each group, whose names and order vary by epoch."""
    generator = np.random.default_rng(seed)
    parts = []
    for epoch in range(count):
        groups = 3 if not unequal else 2 + epoch % 3
        for group in generator.permutation(groups):
            for _ in range(4):
                x = generator.uniform(0, 4)
                y = 0.3 * x + group + 0.1 * generator.standard_normal()
                parts.append((epoch, f"g{group + epoch % 2}", x, y))
    mixed = generator.permutation(len(parts))
    return {"d": {n: [parts[k][i] for k in mixed] for i, n in enumerate(("epoch", "group", "x", "y"))}}


def sharing(count=40, outliers=True, seed=12):
    """A line measured in each epoch, with outliers now and then wrongly."""
    generator = np.random.default_rng(seed)
    epoch, x = np.repeat(np.arange(count), 6), generator.uniform(0, 3, 6 * count)
    y = 1 + 0.3 * x + 0.1 * generator.standard_normal(len(x))
    if outliers:
        y[::31] += 2.0
    return {"d": {"epoch": epoch, "x": x, "y": y}}


def campaigns(count=40, missing=False, outliers=False, seed=7):
    """Height differences between five points, in each campaign all of them, or those of four points in one of three."""
    generator = np.random.default_rng(seed)
    lines = []
    for campaign in range(count):
        heights = np.array([10.0, 11.2, 9.4 + 0.01 * campaign, 12.1, 10.6])
        last = 4 if missing and campaign % 3 == 1 else 5
        for start in range(last):
            for end in range(start + 1, last):
                difference = heights[end] - heights[start] + 0.002 * generator.standard_normal()
                lines.append((campaign, f"p{start}", f"p{end}", difference))
    if outliers:
        lines[::23] = [(c, a, b, d + 0.1) for c, a, b, d in lines[::23]]
    return {
        "points": {"point": [f"p{i}" for i in range(5)], "guess": [10, 11, 9, 12, 10], "datum": [1, 0, 0, 0, 0]},
        "lines": {name: [line[i] for line in lines] for i, name in enumerate(("campaign", "from", "to", "dh"))},
    }


def sessions(count=30, unequal=False, seed=4):
    """A few points seen from two images in each session, or from one, two or three."""
    from scipy.spatial.transform import Rotation

    generator = np.random.default_rng(seed)
    points = generator.uniform([-1, -1, 3], [1, 1, 6], (8, 3))
    parts = []
    for session in range(count):
        for image in range(1 + session % 3 if unequal else 2):
            turn = Rotation.from_rotvec(generator.uniform(-0.2, 0.2, 3)).as_matrix()
            seen = points @ turn.T + generator.uniform(-0.3, 0.3, 3)
            pixels = 500 * seen[:, :2] / seen[:, 2:] + generator.standard_normal((8, 2))
            parts += [(session, 100 * session + image, *points[i], *pixels[i]) for i in range(8)]
    names = ("session", "image", "x", "y", "z", "u", "v")
    return {"d": {name: [part[i] for part in parts] for i, name in enumerate(names)}}


def stations(count=36, seed=6):
    """Stations of each day with a value to start from, two to four of them, and what they measured."""
    generator = np.random.default_rng(seed)
    owned, measured = [], []
    for day in range(count):
        for station in range(2 + day % 3):
            value = 1.0 + station + 0.1 * generator.standard_normal()
            guess = value + 0.2 * (station > 0)
            owned.append((day, f"{day}-{station}", guess, station - 0.5, station + 2.5, float(station == 0)))
            for x in np.linspace(0, 1, 5):
                y = value * np.exp(0.4 * x) + 0.05 * generator.standard_normal()
                measured.append((day, f"{day}-{station}", x, y))
    mixed = generator.permutation(len(measured))
    names = ("day", "station", "guess", "low", "high", "held")
    return {
        "stations": {name: [row[i] for row in owned] for i, name in enumerate(names)},
        "d": {name: [measured[k][i] for k in mixed] for i, name in enumerate(("day", "station", "x", "y"))},
    }


def grouped_track(count=60, rotating=False, seed=11):
    """A drift and an offset for each group over time; groups come in changing order, or come and go."""
    generator = np.random.default_rng(seed)
    parts = []
    for time in range(count):
        for group in generator.permutation(3):
            if rotating and group == 2 and time % 10 == 0:
                group = 2 + time // 10
            y = 0.02 * time + group + 0.05 * generator.standard_normal()
            parts.append((0.1 * time, f"g{group}", np.sin(0.7 * time + group), y))
    return {"d": {name: [part[i] for part in parts] for i, name in enumerate(("time", "group", "x", "y"))}}


def drifting(count=40, seed=9):
    """Sines whose frequency grows from where the start leads to it to where only the window before does, with offsets.

    Groups come in changing order, and one more of them in the second half.
    """
    generator = np.random.default_rng(seed)
    parts = []
    for time in range(count):
        for group in generator.permutation(2 + (time >= count // 2)):
            for x in np.linspace(0, 10, 12):
                y = np.sin((1 + 0.03 * time) * x) + group + 0.05 * generator.standard_normal()
                parts.append((time, f"g{group}", x, y))
    return {"d": {name: [part[i] for part in parts] for i, name in enumerate(("time", "group", "x", "y"))}}


SLID = (
    "(problem slid (data d external) (unknowns (k :init {k}) (b :per d.group {b}))"
    " (observe d (= y (+ {model} (b group))) :sigma {sigma}) (window time :length 1 :step 0.3 :min-rows {least}))"
)
PLAIN = BIASES.format(when="", sigma="0.1", more="")
LOOSE = BIASES.format(when="", sigma="1", more="")
FREE = LEVELLING.format(init="guess", fixed=":fixed (= datum 1)", sigma="2mm", more="").replace("mm", "e-3")
PROBLEMS = {
    "biases": (PLAIN, biases()),
    "biases, two families over one column": (
        BIASES.format(when="", sigma="0.1", more="(observe d (= y (+ 1 (c group))) :sigma 0.3)").replace(
            "(b :per d.group :init 0)", "(b :per d.group :init 0) (c :per d.group :init 0)"
        ),
        biases(unequal=True),
    ),
    "biases, unequal": (PLAIN, biases(unequal=True)),
    "biases without a start": (PLAIN.replace(" :init 0)", ")"), biases(unequal=True)),
    "biases, unknown noise": (BIASES.format(when="", sigma="unknown", more=""), biases(unequal=True)),
    "biases, filtered": (BIASES.format(when=":when (> x 0.4)", sigma="0.1", more=""), biases(unequal=True)),
    "biases, some unused": (BIASES.format(when=":when (< y 1.7)", sigma="0.1", more=""), biases()),
    "biases, a loss": (BIASES.format(when="", sigma="0.1 :loss huber", more=""), biases(unequal=True)),
    "biases, derived": (BIASES.format(when="", sigma="0.1", more="(derive (twice (* 2 v)))"), biases()),
    "biases, a prior": (
        BIASES.format(when="", sigma="0.1", more="").replace("(v :init 0)", "(v :init 0.3 :sigma 0.2)"),
        biases(unequal=True),
    ),
    "biases, priors of members": (
        BIASES.format(when="", sigma="0.1", more="").replace("d.group :init 0", "d.group :init 1 :sigma 2"),
        biases(unequal=True),
    ),
    "biases, one fixed by its name": (
        LOOSE.replace("d.group :init 0", 'd.group :init 1 :fixed (= group "g1")'),
        biases(),
    ),
    "biases, fixed at values by their names": (
        LOOSE.replace("(b :per d.group :init 0)", '(b :per d.group :init (if (= group "g1") 1 2) :fixed true)'),
        biases(),
    ),
    "levelling, priors of members": (FREE.replace(":fixed (= datum 1)", ":sigma (+ 0.5 datum)"), campaigns()),
    "own priors": (OWN.format(limits=":sigma (+ 0.8 low)"), stations()),
    "rows that all share": (SHARED.format(anchored=0.1, sigma=0.1, more="", each="(for-each epoch)"), sharing()),
    "rows that all share, a loss": (
        SHARED.format(anchored="0.1 :loss huber", sigma="0.1 :loss huber", more="", each="(for-each epoch)"),
        sharing(),
    ),
    "rows that all share, unknown noises": (
        SHARED.format(anchored="unknown", sigma="unknown", more="", each="(for-each epoch)"),
        sharing(),
    ),
    "rows that all share, consensus": (
        SHARED.format(anchored=0.1, sigma=0.1, more="(solve :robust lmeds)", each="(for-each epoch)"),
        sharing(),
    ),
    "rows that all share, windows": (
        SHARED.format(anchored=0.1, sigma=0.1, more="", each="(window epoch :length 4 :step 2)"),
        sharing(outliers=False),
    ),
    "levelling, limits": (
        FREE.replace("(for-each", '(constraints (<= (h "p2") 9.6) (= (- (h "p3") (h "p1")) 0.9)) (for-each'),
        campaigns(),
    ),
    "own limits": (
        OWN.format(limits="").replace("(for-each", "(constraints (>= (o station) 1.02 :over stations)) (for-each"),
        stations(),
    ),
    "levelling": (FREE, campaigns()),
    "levelling, points missing": (FREE, campaigns(missing=True)),
    "levelling, a difference": (
        FREE.replace("(for-each", '(derive (rise (- (h "p2") (h "p1")))) (for-each'),
        campaigns(missing=True),
    ),
    "levelling, unknown noise": (FREE.replace("2e-3", "unknown"), campaigns()),
    "levelling, a loss": (FREE.replace("2e-3", "2e-3 :loss soft-l1"), campaigns(outliers=True)),
    "levelling, a loss that is not convex": (FREE.replace("2e-3", "2e-3 :loss cauchy"), campaigns(outliers=True)),
    "levelling, consensus": (FREE.replace("(for-each", "(solve :robust lmeds) (for-each"), campaigns(outliers=True)),
    "levelling, gross errors": (FREE, campaigns(outliers=True)),
    "levelling without a datum": (FREE.replace(":fixed (= datum 1)", ""), campaigns()),
    "poses": (POSES, sessions()),
    "poses, unequal": (POSES, sessions(unequal=True)),
    "own starts": (OWN.format(limits=""), stations()),
    "own bounds": (OWN.format(limits=":in (low high)"), stations()),
    "own datum": (OWN.format(limits=":fixed (= held 1)"), stations()),
    "windows": (SLID.format(k=0, b=":init 0", model="(* k x)", sigma="0.05", least=3), grouped_track()),
    "windows, not linear": (
        SLID.format(k=0.1, b=":init 0", model="(sin (* k x))", sigma="0.05", least=3),
        grouped_track(),
    ),
    "windows that do not fit": (
        SLID.format(k=0.1, b=":init 0", model="(sin (* k x))", sigma="0.01", least=3),
        grouped_track(),
    ),
    "windows, groups come and go": (
        SLID.format(k=0.1, b=":init 0", model="(sin (* k x))", sigma="unknown", least=3),
        grouped_track(rotating=True),
    ),
    "windows with several minima": (
        "(problem sines (data d external) (unknowns (w :init 1) (b :per d.group :init 0))"
        " (observe d (= y (+ (sin (* w x)) (b group))) :sigma 0.05) (window time :length 1 :step 1))",
        drifting(),
    ),
    "windows with few rows": (
        SLID.format(k=0.1, b=":init 0", model="(sin (* k x))", sigma="0.05", least=29),
        grouped_track(),
    ),
}
