"""A family's manual as data: rows, types, points, state, identification. Start at `schema` and `load`."""
