"""Triangle and polygon meshes from files: what stands in them, with the numbers that it has there."""
