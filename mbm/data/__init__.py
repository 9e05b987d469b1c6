"""Makes tables from files, from what the Python API is given and from the rows written in a problem."""
