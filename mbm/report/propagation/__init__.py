"""What a propagation of distributions answers: documents, tables, samples."""
