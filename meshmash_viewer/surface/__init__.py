"""Geometry of surfaces, without VTK."""
