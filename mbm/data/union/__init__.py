"""Several tables or files of the same columns as one table."""
