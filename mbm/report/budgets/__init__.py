"""Uncertainty budgets: which input makes how much of the uncertainty of an estimate or a derived quantity."""
