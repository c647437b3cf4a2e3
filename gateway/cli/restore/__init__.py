"""`backup` and `restore`: configuration and state of a gateway, stored and put back. Start at either."""
