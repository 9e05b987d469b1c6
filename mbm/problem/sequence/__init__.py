"""Sequences: unknowns that change from step to step, how they change, and the tables that are made of the steps."""
