"""The equations in SymPy: one block for each group of rows that share their equations, ready to be differentiated."""
