"""Doubts about an answer: nonlinearity, priors against data."""
