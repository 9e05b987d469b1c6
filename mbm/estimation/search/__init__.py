"""Local minima from many starts, compared with closed forms."""
