"""Conformance suites for what plugs in: readers, evaluation backends, solvers; they raise `NotConforming`."""
