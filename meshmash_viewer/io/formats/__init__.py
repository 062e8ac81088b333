"""One module a mesh format; each turns a file into a `RawMesh` or raises `InputError`."""
