"""Points, distances and bearings as arrays → positions, rotations and scales in closed form; many problems at once."""
