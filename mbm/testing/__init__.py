"""Conformance suites for what plugs in (readers, evaluation backends, methods), for those who write one."""
