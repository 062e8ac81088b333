"""The controls of each kind of field."""
