"""What generated solvers do besides solving, once for all languages, in restricted Python."""
