"""Consensus estimators: one file each, listed in ``standard.py``; what they share lies in the room above."""
