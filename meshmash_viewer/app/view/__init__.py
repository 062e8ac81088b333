"""What draws: a mesh with a field, its marks and its overlay, with VTK and without Qt."""
