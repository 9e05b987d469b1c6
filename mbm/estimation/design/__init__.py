"""Experiments before they are made: what rows of a Jacobian would tell, and which of them to choose."""
