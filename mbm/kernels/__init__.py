"""SymbolicModel → KernelSet: CasADi differentiates; kernels evaluate residuals and Jacobians for all rows in one call."""
