"""`watch`: a live table of the starters in the terminal, from MQTT alone. Start at `watch`."""
