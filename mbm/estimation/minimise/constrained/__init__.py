"""Least squares with equations and inequalities that must hold → a minimum with its multipliers and active set."""
