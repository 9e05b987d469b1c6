"""SymbolicModel → KernelSet: CasADi differentiates; kernels evaluate all rows in one call."""
