"""C99 that needs the mathematical library only."""
