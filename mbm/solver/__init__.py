"""The solver itself, in the little language: one text for LLVM, C and Python."""
