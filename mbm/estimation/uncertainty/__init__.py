"""Rank, covariance, undetermined directions, derived quantities."""
