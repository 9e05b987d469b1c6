"""Python that needs NumPy only."""
