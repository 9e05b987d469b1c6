"""The little language: restricted Python with records, printed as machine code, C and Python; straight-line code."""
