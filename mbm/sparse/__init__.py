"""Least squares with many unknowns: normal equations in blocks, elimination, Cholesky factors, marginal variances."""
