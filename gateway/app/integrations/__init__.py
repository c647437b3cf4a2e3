"""What else takes the gateway's records; each is switched on by a table of the configuration, on its own.

Start at `integration`, which begins, reloads and ends any of them; the others are one integration each.
"""
