"""What files of cameras and points of one scene have in common."""

from __future__ import annotations

PARTS = ("cameras", "images", "points", "observations")
"""The tables of such files."""

POSE = ("qw", "qx", "qy", "qz", "x", "y", "z")
"""Columns of a pose: a quaternion and a translation."""
