"""Makes the result document, the table a person reads, CSV files and plots from solved problems."""
