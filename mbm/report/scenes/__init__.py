"""Estimates as files of other programs: scenes of cameras and points, pose graphs, trajectories."""
