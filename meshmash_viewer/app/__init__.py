"""The main window. All of its modules may import Qt; only the render imports VTK."""
