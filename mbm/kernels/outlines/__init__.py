"""Outlines of silhouettes: where they run, what is read off them, and how that varies."""
