"""`backup`: configuration and state of a gateway in one file. Start at `backup`."""
