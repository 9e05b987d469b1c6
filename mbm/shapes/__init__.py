"""Models become shapes: trees of parts, transforms and surfaces whose features are named by paths."""
