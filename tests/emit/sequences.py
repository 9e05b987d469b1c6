"""Problems with states, with data, of which filters are generated: every kind of rows, transitions and methods."""

from __future__ import annotations

import numpy as np

STEPS = 9


def table(step="k", steps=STEPS, seed=1, **columns):
    """Rows of steps: two at every third, none at the fifth."""
    generator = np.random.default_rng(seed)
    k = np.array([j for j in range(steps) for _ in range(2 if j % 3 == 0 else 1) if j != 5], dtype=float)
    made = {name: np.asarray(column(k, generator)) for name, column in columns.items()}
    return {step: k, **made}


def noisy(k, generator):
    """A wave with noise."""
    return np.sin(0.4 * k) + 0.1 * generator.standard_normal(len(k))


FRAMES = {"k": np.arange(STEPS, dtype=float)}

CART = """
(problem cart
  (data frames external) (data z external)
  (unknowns (b :init 0.1 :sigma 0.5))
  (states :over k (x :init 0 :sigma 1))
  (dynamics (constant-velocity x :acceleration 0.3 :velocity 0.2 :velocity-sigma 0.5))
  (observe z (= y (+ x b)) :sigma {sigma})
  {rest}
  (solve :method {method}))"""
"""Plain rows, or with noise of their own."""

STATIONS = """
(problem stations
  (data frames external) (data z external :with (anchors at) :where (> y -5))
  (data anchors (table (name h) ("a" 0.0) ("b" 0.5)) :key name)
  (unknowns (lift :per anchors :init 0 :sigma 0.3))
  (states :over k (x :init 0 :sigma 1) (s :init 1 :sigma 0.2))
  (dynamics (= (next x) (+ x (* 0.1 go (dt))) :sigma (* 0.2 (sqrt (dt)))) (static s))
  (observe z (= y (* s (+ x (lift at)))) :sigma (+ 0.2 anchors.h) :when (> w 0.2))
  (observe z (= y (if (= kind "near") x (* 2 x))) :sigma 0.4)
  (observe anchors (= h (lift name)) :sigma 0.1)
  {rest}
  (solve :method {method}))"""
"""Rows that pick members, are joined, left out, of kinds with equations of their own; transitions that take columns."""

DRIVE = """
(problem drive
  (data wheels external) (data ranges external)
  (states :over k (at (pose 2) :init (pose2 0 0 0) :sigma 0.3))
  (dynamics (= (next at) (compose at (pose2 forward 0 turn)) :sigma [0.03 0.05 0.02]))
  (observe ranges (= d (distance (translation at) [px py])) :sigma 0.1)
  {rest}
  (solve :method {method}))"""

RUNS = """
(problem runs
  (data z external) (data setups (table (run h s) ("one" 0.1 0.1) ("two" 0.5 0.2) ("three" -0.2 0.1)) :key run)
  (data frames external)
  (unknowns (b :init 0.1 :sigma 0.5))
  (states :over k (x :init 0 :sigma 1))
  (dynamics (= (next x) (+ x (* 0.1 (first setups h))) :sigma 0.3))
  (observe z (= y (+ x b (first setups h))) :sigma (first setups s))
  (observe setups (= h b) :sigma 0.4)
  (derive (res (- y x) :over z) (off (+ x (first setups h))) (scaled (* b h) :over setups))
  (for-each run) {rest}
  (solve :method {method}))"""
"""A sequence for each run, with numbers of its own, of which one table has steps."""

ARM = """
(problem arm
  (data frames external) (data seen external)
  (unknowns (l :init 1 :sigma 0.2))
  (states :over k (a :init 10deg :sigma 20deg :unit deg))
  (dynamics (random-walk a :sigma 15deg))
  (observe seen (= x (* l (cos a))) :sigma 0.02)
  (constraints (<= (abs a) 170deg))
  (solve :method truncated-ekf :hypotheses 4))"""
"""Seen from the side a turn to the left is as one to the right."""


def cart(method, sigma="0.1", rest=""):
    """The cart with its data."""
    made = table(y=noisy, s=lambda k, g: 0.05 + 0.1 * g.random(len(k)))
    return CART.format(method=method, sigma=sigma, rest=rest), {"frames": FRAMES, "z": made}


def stations(method, rest=""):
    """The stations with their data."""
    z = table(
        y=noisy,
        w=lambda k, g: g.random(len(k)),
        at=lambda k, g: g.choice(["a", "b"], len(k)),
        kind=lambda k, g: g.choice(["near", "far"], len(k)),
    )
    frames = {**FRAMES, "go": np.cos(FRAMES["k"])}
    return STATIONS.format(method=method, rest=rest), {"frames": frames, "z": z}


def drive(method, rest=""):
    """The drive with its data."""
    k = FRAMES["k"]
    wheels = {"k": k, "forward": np.full(STEPS, 1.0), "turn": np.full(STEPS, 0.1)}
    ranges = table(
        px=lambda k, g: 5.0 * g.standard_normal(len(k)),
        py=lambda k, g: 5.0 + g.standard_normal(len(k)),
        d=lambda k, g: 5.0 + 0.1 * g.standard_normal(len(k)),
    )
    return DRIVE.format(method=method, rest=rest), {"wheels": wheels, "ranges": ranges}


def runs(method, rest=""):
    """The runs with their data, one among the other."""
    generator = np.random.default_rng(3)
    rows = [(k, run) for k in range(8) for run in ("two", "one", "three") for _ in range(1 + (k % 3 == 0))]
    k, run = zip(*(rows[j] for j in range(len(rows)) if j % 5 != 3), strict=True)
    z = {"k": np.array(k, dtype=float), "run": list(run), "y": noisy(np.array(k), generator)}
    return RUNS.format(method=method, rest=rest), {"z": z, "frames": FRAMES}


def arm():
    """The arm with its data."""
    seen = table(x=lambda k, g: np.cos(0.1 * k) + 0.01 * g.standard_normal(len(k)))
    return ARM, {"frames": FRAMES, "seen": seen}


def plain(text, **columns):
    """A text with the table ``z`` of some columns."""
    return text, {"z": table(**columns)}
