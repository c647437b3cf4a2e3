"""Sets of parameters: read, compared, restored, as TOML; start at `model`."""
