"""Kernels as machine code: compiled by LLVM in this process, kept in a store, called on blocks of rows."""
