"""Geometry of a surface that the view needs, without VTK."""
