"""Division of large meshes into overlapping pieces, which are computed separately and stitched."""
