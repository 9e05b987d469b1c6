"""The steps of sequences in words, as `mbm check` and `mbm explain` tell them."""

from __future__ import annotations

from mbm.api import sequences

TEXT = """
(problem cart
  (data seen (table (t x) (0 0.1) (1 0.4) (2 0.9) (6 2.5)))
  (data frames (table (t) (0) (1) (2) (4) (6)))
  (states :over t (x1 :init 0 :sigma 1))
  (dynamics (random-walk x1 :sigma 0.5))
  (observe seen (= x x1) :sigma 0.05 :when (< t 6)))
(problem line (data d (table (x y) (0 1) (1 2))) (unknowns (a) (b)) (observe d (= y (+ a (* b x)))))
"""


def test_steps_and_those_that_nothing_is_seen_of(tmp_path):
    path = tmp_path / "cart.mbm"
    path.write_text(TEXT)
    words = "5 steps from 0 to 6: the values of t in seen, frames; 2 without a row that is observed"
    assert sequences(path) == (f"problem `cart`: {words}",)
    assert sequences(path, problem="line") == ()
