"""Unknown noise beside a robust loss: the cost and the covariance hold with the final factors."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

TEXT = """
(problem means
  (data lossy external)
  (data plain external)
  (data other external)
  (unknowns (a :init 0) (b :init 0) (c :init 0))
  (observe lossy (= y a) :sigma 1 :loss (huber 3))
  (observe plain (= y b) :sigma unknown)
  (observe other (= y c) :sigma unknown))
"""


def test_means_beside_a_loss_have_the_noise_of_their_own_group():
    random = np.random.default_rng(4)
    lossy = random.uniform(-1.0, 1.0, 12)  # within three deviations of any mean of them: the loss is a square
    plain, other = 5.0 * random.normal(size=9), 0.2 * random.normal(size=15)
    result = mbm.loads(TEXT).solve(data={"lossy": {"y": lossy}, "plain": {"y": plain}, "other": {"y": other}})
    # Iterated to 1e-9 of each factor; the closed forms of a mean and its standard deviation.
    for name, values in (("b", plain), ("c", other)):
        assert float(result[name].value) == pytest.approx(values.mean(), abs=1e-9)
        assert float(result[name].sigma) == pytest.approx(values.std(ddof=1) / np.sqrt(values.size), rel=1e-8)
    # Several factors count as their final values (each group: its redundancy), stated noise as stated.
    squares = float(np.square(lossy - lossy.mean()).sum())
    assert result.first.cost == pytest.approx(squares + (plain.size - 1) + (other.size - 1), rel=1e-8)
