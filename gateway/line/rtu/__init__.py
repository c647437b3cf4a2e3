"""One request and its reply in Modbus RTU, with the silences around them. Start at `master`."""
