"""The solver and the kernels of a problem as machine code, or run as Python where none can be made."""
