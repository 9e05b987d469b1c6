"""Makes the expected answers of those problems that nobody published, with NumPy and SciPy and without mbm."""
