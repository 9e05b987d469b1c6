"""Solvers, one algorithm a file: ``init``, then ``step`` until ``finished``."""
