"""The built-in functions of LANGUAGE §2 and §6, one family per file, each exporting ``FUNCTIONS``."""
