"""Equations with errors in measured columns → residuals of the unknowns alone: the corrections are solved for inside."""
