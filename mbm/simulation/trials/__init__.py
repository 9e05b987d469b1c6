"""Propagation of distributions: trials of a solve with inputs drawn as they are."""
