"""Least squares with many unknowns: block-sparse normal equations, elimination, Cholesky factors, marginal variances."""
