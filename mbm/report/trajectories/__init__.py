"""Errors of aligned trajectories as the field states them: of positions and rotations, absolute and over steps."""
