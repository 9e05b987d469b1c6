"""The solver itself, in the restricted Python of the target language: one text for LLVM, C and Python."""
