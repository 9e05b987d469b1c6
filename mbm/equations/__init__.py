"""What the rows of a problem are to a solver: layout, whitening, binding, manifolds, windows."""
