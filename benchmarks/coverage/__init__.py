"""Stated 95 % intervals against simulated truth, for every kind of problem that a laboratory may try.

python -m benchmarks.coverage [--runs 2000] [--seed 1] [KIND…]
"""

from __future__ import annotations
