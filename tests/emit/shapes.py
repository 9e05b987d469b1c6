"""One small problem for each shape that generated solvers have to take."""

from __future__ import annotations

from tests.emit.agreeing import AGREEING

LINE = "(data d (table (x y) (0 1.1) (1 2.9) (2 5.2) (3 6.8) (4 9.1) (5 17.0)))"

TURNS = """(problem turns "An angle at the cut, between readings on both sides of it, and what it turns."
  (data d (table (y z) (3.141 1) (-3.141 1.2)))
  (unknowns (a angle) (b))
  (observe d (= (angle y) a) (= z (- b (cos a))) :sigma 0.1))"""

SHAPES = {
    "plain": f"""(problem plain "A straight line." {LINE}
      (unknowns (a :init 1 :doc "slope") (b :init 0))
      (observe d (= y (+ (* a x) b)) :sigma 0.2))""",
    "weights": """(problem weights "A point, measured in both coordinates together."
      (data d (table (u v s c) (1.0 2.1 0.04 0.01) (1.2 1.9 0.05 -0.02) (0.9 2.0 0.09 0.03)))
      (unknowns (p (vector 2) :init [0 1]))
      (observe d (= [u v] [(p 1) (* (p 2) (p 2))]) :covariance [[s c] [c (* 2 s)]]))""",
    "information": """(problem information
      (data d (table (u v s c) (1.0 2.1 9 1) (1.2 1.9 8 -2) (0.9 2.0 7 3)))
      (unknowns (p (vector 2) :init [1 1]))
      (observe d (= [u v] [(p 1) (* (p 2) (p 2))]) :information [[s c] [c (* 2 s)]]))""",
    "loss": f"""(problem loss "A straight line with an outlier." {LINE}
      (unknowns (a :init 2) (b :init 1))
      (observe d (= y (+ (* a x) b)) :sigma 0.2 :loss (huber 1.5)))""",
    "losses": """(problem losses
      (data d (table (x y) (0 1.1) (1 2.9) (2 5.2) (3 6.8) (4 9.1) (5 12)))
      (data e (table (u v) (1.1 0.9) (0.8 1.2) (1.0 1.0) (1.3 0.7) (3 3)))
      (unknowns (a :init 2) (b :init 1))
      (observe d (= y (+ (* a x) b)) :sigma 0.2 :loss cauchy)
      (observe e (= [u v] [b (/ a 2)]) :sigma 0.2 :loss (barron 0.5 2)))""",
    "bounds": f"""(problem bounds "A prior, and a bound that holds." {LINE}
      (unknowns (a :init 1.5 :in (0 2) :sigma 0.1) (b positive :init 0.1))
      (observe d (= y (+ (* a x) b)) :sigma 0.2))""",
    "equations": """(problem equations "Three angles that add up."
      (data d (table (corner angle) (1 59.8) (2 60.3) (3 60.4)) )
      (unknowns (q (array 3) :init 60))
      (observe d (= angle (q corner)) :sigma 0.1)
      (constraints (= (+ (q 1) (q 2) (q 3)) 180)))""",
    "inequalities": f"""(problem inequalities "One inequality holds, the other does nothing." {LINE}
      (unknowns (a :init 1) (b :init 0.5))
      (observe d (= y (+ (* a x) b)) :sigma 0.2)
      (constraints (<= (+ a b) 3) (>= b -10)))""",
    "rotation": """(problem rotation "A frame turned, from directions in it."
      (data d (table (x y z u v w) (1 0 0 0.36 0.93 0.1) (0 1 0 -0.93 0.35 0.05) (0 0 1 0.02 -0.12 0.99)
        (1 1 0 -0.56 1.3 0.14)))
      (unknowns (R (rotation 3) :init (axis-angle [0.1 -0.1 1])))
      (observe d (= [u v w] (rotate R [x y z])) :sigma 1cm))""",
    "pose": """(problem pose "Where a camera frame is, and which way a vector points."
      (constants (offset 0.5))
      (data d (table (x y z u v w) (1 0 0 2.36 1.93 0.1) (0 1 0 1.07 1.35 0.05) (0 0 1 2.02 0.88 0.99)
        (1 1 0 1.44 2.3 0.14)))
      (data e (table (s) (0.45) (0.51)))
      (unknowns (T (pose 3) :init (pose3 (axis-angle [0.1 -0.1 1]) [2 1 0]) :unit m) (n direction :init [1 2 3]))
      (observe d (= [u v w] (transform T [x y z])) :sigma 1cm)
      (observe e (= (+ s offset) (+ offset (n 1))) :sigma 0.05)
      (observe turned e (= (* 1.4 s) (n 2)) :sigma 0.05))""",
    "similarity": """(problem similarity "A plan laid onto a map."
      (data d (table (x y u v) (0 0 10.1 5) (1 0 11.6 7.2) (0 1 7.9 6.5) (1 1 9.3 8.4)))
      (unknowns (S (similarity 2)))
      (observe d (= [u v] (transform S [x y])) :sigma 10cm))""",
    "family": """(problem family "Heights of marks from differences; one mark is known, one is no part of it."
      (data marks (table (id height known) ("a" 10 1) ("b" 11 0) ("c" 12 0) ("unused" 13 0)) :key id)
      (data steps (table (from to rise s) ("a" "b" 1.21 1) ("b" "c" 0.83 2) ("a" "c" 2.06 1) ("c" "b" -0.84 1)))
      (unknowns (h :per marks :init height :fixed (= known 1) :unit m))
      (observe steps (= rise (- (h to) (h from))) :sigma (* s 1cm)))""",
    "distinct": """(problem distinct "One offset for each value of a column; some rows are left out."
      (data d (table (kind x y good) ("a" 1 2.1 1) ("b" 2 4.5 1) ("a" 3 6.1 1) ("c" 4 9.9 0) ("b" 5 10.4 1) ("b" 0 9 0))
        :where (= good 1))
      (unknowns (k :init 1) (o :per d.kind :init 0))
      (observe d (= y (+ (* k x) (o kind))) :sigma 0.1 :when (< x 10)))""",
    "joined": """(problem joined "Ranges to known places."
      (data places (table (id x y) ("north" 0 10) ("east" 10 0) ("west" -10 1)) :key id)
      (data ranges (table (place r) ("north" 8.1) ("east" 9.2) ("west" 10.9) ("north" 8.0)) :with (places place))
      (unknowns (p (vector 2) :init [1 1] :unit cm))
      (observe ranges (= r (distance p [places.x places.y])) :sigma 5cm))""",
    "bend": """(problem bend "A curve that was moved, from points beside it and from its highest point."
      (data d (table (x y) (0.4 1.21) (0.9 2.02) (2.1 2.95) (3.2 2.35) (4.4 1.0) (5.6 0.72)))
      (data top (table (n v) (1 2.9)))
      (define (moved (trans t (spline ((0 0) (1 2) (3 2.5) (4 1) (6 0.5))))))
      (unknowns (t (vector 2) :init [0 0]))
      (observe d (= 0 (curve-distance moved [x y])) :sigma 0.05)
      (observe top (= v (((extrema moved 2) n) 2)) :sigma 0.1))""",
    "for-each": """(problem for-each "One mean for each day."
      (data d (table (day y) (1 1.1) (1 0.9) (2 3.2) (1 1.3) (2 2.7) (3 5) (3 6)))
      (unknowns (m :init 0))
      (observe d (= y m) :sigma 0.5)
      (for-each day))""",
    "keys": """(problem keys "A level for each day and a slope; some days are in one table only."
      (data d (table (day y) (1 1.1) (1 0.9) (2 3.2) (1 1.3) (2 2.7)))
      (data e (table (day z s) (2 5.9 2) (3 6.3 2) (2 3.1 1) (3 3.2 1) (1 2.2 2)))
      (unknowns (m :init 0))
      (observe d (= y m) :sigma 0.5)
      (observe e (= z (* s m)) :sigma 0.5)
      (for-each day))""",
    "derived": """(problem derived "Heights of marks; what is derived of them, once and for each row."
      (data marks (table (id height known) ("a" 10 1) ("b" 11 0) ("c" 12 0) ("unused" 13 0)) :key id)
      (data steps (table (from to rise s) ("a" "b" 1.21 1) ("b" "c" 0.83 2) ("a" "c" 2.06 1) ("c" "b" -0.84 1)))
      (unknowns (h :per marks :init height :fixed (= known 1) :unit m))
      (observe steps (= rise (- (h to) (h from))) :sigma (* s 1cm))
      (derive (climb (- (h to) (h from)) :over steps :unit cm) (top (max (h "b") (h "c")) :unit m)
        (both [(h "b") (* 2 (h "c"))] :unit m)))""",
    "noise": f"""(problem noise "The noise is told by the residuals." {LINE}
      (unknowns (a :init 1) (b :init 0))
      (observe d (= y (+ (* a x) b)) :sigma unknown))""",
    "noises": """(problem noises "Two groups of unknown noise, and one that is stated."
      (data d (table (x y) (0 1.1) (1 2.9) (2 5.2) (3 6.8) (4 9.1) (5 11.3)))
      (data e (table (u) (1.2) (0.7) (1.3) (0.8)))
      (unknowns (a :init 2) (b :init 1 :sigma 0.5))
      (observe d (= y (+ (* a (exp (* 0.01 x)) x) b)) :sigma unknown)
      (observe e (= u b) :sigma (unknown 0.5)))""",
    "loss-and-noise": """(problem loss-and-noise "A loss, and noise beside it that its residuals tell."
      (data d (table (x y) (0 1.1) (1 2.9) (2 5.2) (3 6.8) (4 9.1) (5 17.0)))
      (data e (table (u) (1.2) (0.7) (1.3) (0.8)))
      (unknowns (a :init 2) (b :init 1))
      (observe d (= y (+ (* a x) b)) :sigma 0.2 :loss (huber 1.5))
      (observe e (= u b) :sigma (unknown 0.5)))""",
    # The last change of a factor is just below what ends the rounds: a solve less, and the covariance is 2e-9 off.
    "slow-noises": """(problem slow-noises "Two groups of unknown noise whose factors settle over many rounds."
      (data d (table (x y) (1.4 3.9) (2.4 5.53) (3 7.21) (5 11.04)))
      (data e (table (x y) (3 8.44) (3.1 7.58) (3.4 8.77)))
      (unknowns (a :init 2) (b :init 1))
      (observe d (= y (+ (* a x) b)) :sigma unknown)
      (observe e (= y (+ (* a x) b)) :sigma (unknown 0.5)))""",
    "determined": """(problem determined "Two constraints leave one unknown no freedom: its variance is zero."
      (data d (table (x y z) (1 1.1 0.7) (2 2.3 0.9) (3 2.8 0.8) (4 4.3 0.7)))
      (unknowns (p (vector 3) :init [1 1 1]))
      (observe d (= [y z] [(+ (* (p 1) x) (p 2)) (* (p 3) (+ 1 (* 0.1 (p 1))))]) :sigma 0.1)
      (constraints (= (p 1) (+ (p 2) (p 3))) (<= (p 3) 0.6)) (solve :constraints exact))""",
    "errors": """(problem errors "Both coordinates of a line are measured with errors."
      (data d (table (x y s) (0 5.9 1) (0.9 5.4 0.75) (1.8 4.4 0.5) (2.6 4.6 0.35) (3.3 3.5 0.2) (4.4 3.7 0.2)))
      (unknowns (a :init 5) (b :init 0))
      (observe d (= y (+ a (* b x))) :errors ((x 0.1) (y s))))""",
    "errors-beside-loss": """(problem errors-beside-loss "Errors in both coordinates; a loss of other rows."
      (data d (table (x y s) (0 5.9 1) (0.9 5.4 0.75) (1.8 4.4 0.5) (2.6 4.6 0.35) (3.3 3.5 0.2) (4.4 3.7 0.2)))
      (data e (table (t z) (0 5.6) (1 5.2) (2 4.7) (3 9.1) (4 3.7) (5 3.1)))
      (unknowns (a :init 5) (b :init 0) (c :init 0))
      (observe d (= y (+ a (* b x))) :errors ((x 0.1) (y s)))
      (observe e (= z (+ a (* b t) c)) :sigma 0.2 :loss (huber 1.5)))""",
    "rim": """(problem rim "A circle through points with errors in both coordinates: equations without a measured side."
      (data d (table (x y) (1.02 0.01) (0.7 0.72) (0.01 0.98) (-0.7 0.69) (-0.99 0.02) (-0.72 -0.7)))
      (unknowns (c (vector 2) :init [0.1 0.1]) (r :init 1.1))
      (observe d (= (hypot (- x (c 1)) (- y (c 2))) r) :errors ((x 0.02) (y 0.03))))""",
    "moved-masts": """(problem moved-masts "Ranges to masts that stand uncertainly: errors that rows share."
      (data masts (table (id x y s) ("a" 0 10 0.1) ("b" 10 0 0.1) ("c" -10 1 0.2)) :key id)
      (data ranges (table (mast r) ("a" 8.08) ("b" 9.26) ("c" 11.1) ("a" 8.1) ("c" 11.0)) :with (masts mast))
      (unknowns (p (vector 2) :init [1 1]))
      (observe ranges (= r (distance p [masts.x masts.y])) :sigma 5cm :errors ((masts.x masts.s))))""",
    **AGREEING,
}
"""By name; inline tables, so that what is generated depends on nothing but the text."""

CORRECTED = ("errors", "errors-beside-loss", "rim", "moved-masts")
"""Shapes whose solvers have more unknowns than the problem: the true values of measured columns, behind the others."""
