"""Panels in the docks of the window, such as mesh, field, labels, spectrum and profiles."""
