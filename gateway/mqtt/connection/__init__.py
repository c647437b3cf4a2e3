"""One connection to the broker at a time, on the application's loop. Start at `broker`."""
