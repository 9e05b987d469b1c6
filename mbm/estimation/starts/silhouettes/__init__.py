"""Starts for what is seen by its outline alone."""
