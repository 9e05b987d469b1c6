"""Guaranteed bounds by interval arithmetic: contractors, bisection, and the pieces of what is left."""
