"""Division of large meshes into overlapping pieces, and stitching of results of the pieces."""
