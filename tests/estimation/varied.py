"""Small problems whose equations differ in structure, and points about their starts."""

from __future__ import annotations

import numpy as np

PROBLEMS = {
    "two equations in a row, one of them with a covariance, shared unknowns and a prior": """
(problem p
  (data d (table (x y u v) (0 1 0.1 2) (1 3 0.4 4) (2 4 0.7 5) (3 4 1.2 9)))
  (unknowns (a :init 0.3) (b positive :init 1 :sigma 0.5) (c :init 0.1 :in (-1 3)))
  (observe d (= y (+ a (* b x))) :sigma 0.5)
  (observe e d (= [u v] [(* b (exp (* c x))) (+ a (* x c c))]) (= v (* x c)) :sigma 0.2)
  (observe f d (= [u v] [(* a x) (* b x)]) :covariance [[0.04 0.01] [0.01 0.09]]))""",
    "families and a robust loss": """
(problem p
  (data s (table (k x y) ("a" 0 0) ("b" 3 0) ("c" 0 4)) :key k)
  (data d (table (from to r) ("a" "b" 3.1) ("b" "c" 5.2) ("c" "a" 4.5) ("a" "b" 2.9) ("b" "a" 7)))
  (unknowns (p (vector 2) :per s :init [(+ x 0.1) (- y 0.2)]))
  (observe d (= r (distance (p from) (p to))) :sigma 0.1 :loss (huber 1.5))
  (observe g s (= [x y] (p k)) :sigma 1))""",
    "poses, directions and angles": """
(problem p
  (data d (table (x y z u v w) (1 0 0 0.1 1 0.2) (0 1 0 -1 0.2 0.1) (0 0 1 0.3 0.1 1) (1 1 0 -1 1.3 0.2)))
  (unknowns (T (pose 3) :init (pose3 (euler 0.1 0.2 1.5) [0 0 0])) (n direction :init [0 0.1 1]) (h angle :init 0.2))
  (observe d (= [u v w] (transform T [x y z])) :sigma 0.1)
  (observe e d (= h (- (dot n [u v w]) z)) :sigma 0.2))""",
    "a table that is sampled where an unknown says": """
(problem p
  (data path (table (t x y) (0 0 1) (1 0.8 0.5) (2 0.9 -0.4) (3 0.1 -1) (4 -0.8 -0.7)))
  (data d (table (s r) (0.5 2.4) (1.2 2.2) (1.9 2.3) (2.5 2.7) (3.1 3.2)))
  (unknowns (late :init 0.1) (q (vector 2) :init [3 0]))
  (observe d (= r (distance q (sample path [x y] (+ s late) :by t))) :sigma 0.05)
  (observe (= late 0.1) :sigma 0.01))""",
}
ROWS = "\n".join(f"({k} {np.cos(k):.4f} {np.sin(k):.4f} {1.1 * np.cos(k + 0.1):.4f})" for k in range(84))
PROBLEMS["more unknowns than kernels are called for"] = f"""
(problem p
  (data d (table (k x y z) {ROWS}) :key k)
  (unknowns (a :per d :init x))
  (observe d (= [y z] [(* (a k) (a k)) (a k)]) :sigma 0.1))"""


def points_about(equations, count, seed=0):
    random = np.random.default_rng(seed)
    steps = 0.05 * random.normal(size=(count, equations.dimension))
    return np.array([equations.retract(equations.numbers, step) for step in steps])
