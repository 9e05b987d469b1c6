"""Unknowns without a start → their values in closed form, where the equations are of a kind that is known."""
