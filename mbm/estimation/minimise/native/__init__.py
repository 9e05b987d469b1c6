"""Solves in native code: equations as flat arrays, and what comes back."""
