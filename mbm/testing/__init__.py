"""Conformance suites for what plugs in (readers, evaluation backends, solvers), for those who write one."""
