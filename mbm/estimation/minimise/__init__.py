"""One local minimum: the compiled solver, the sparse solver, constraints."""
