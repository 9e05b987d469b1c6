"""Equations as arrays → a minimum, and how far it can be trusted: rank, covariance, noise."""
