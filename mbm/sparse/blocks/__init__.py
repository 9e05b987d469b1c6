"""Routines of block-sparse algebra in the little language: products of Jacobian blocks, Schur elimination, its inverse.

They are written once, as Python functions that also run as they stand; the sizes of blocks are constants of the text,
so that the inner loops are unrolled and vectorised. Arrays never overlap. Routines that take ``first`` and ``last`` do
a part of the work that no other part writes to, so that parts may run at the same time.
"""
