"""Geometry of surfaces, computed without VTK."""
