"""Likelihoods of observations whose errors are not normal with stated weights, as residuals for least squares."""
