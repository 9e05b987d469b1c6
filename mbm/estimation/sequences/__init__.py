"""Sequences: filters and smoothers over the steps of a problem with states, a data set of a local problem for each."""
