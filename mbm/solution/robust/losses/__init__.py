"""Robust losses: one file each, listed in ``standard.py``; with a parameter they act on the equations of a solve."""
