"""The window. Everything in here may import Qt; only the render imports VTK."""
