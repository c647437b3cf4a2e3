"""Sparkplug B 3.0: the gateway as an edge node, its starters as devices, on a connection of its own.

Start at `node`, which decides what is published next, and at `service`, the loop around it; `commands` makes
commands of what hosts write. All but `service` and `host_commands` is pure.
"""
