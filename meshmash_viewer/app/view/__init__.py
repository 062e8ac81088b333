"""Rendering of meshes with fields and annotations, by VTK."""
