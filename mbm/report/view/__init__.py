"""What `mbm view` draws: models with their hidden lines, scenes of cameras and points, measurements in their images."""
