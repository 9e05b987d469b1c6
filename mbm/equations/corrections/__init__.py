"""Equations with errors in measured columns → residuals of the unknowns alone: corrections are solved for inside."""
