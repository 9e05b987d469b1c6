"""Serialised CasADi functions."""
