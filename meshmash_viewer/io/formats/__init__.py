"""Readers of mesh formats, which return the content of a file as a `RawMesh`."""
