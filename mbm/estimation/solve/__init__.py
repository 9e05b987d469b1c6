"""One solve from its starts to its statistics."""
