"""Degrees of freedom, coverage factors and intervals of what is estimated and derived."""
