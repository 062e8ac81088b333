"""The docks of the window: mesh, field, spectrum, profiles."""
