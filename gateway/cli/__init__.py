"""The command line: one module for each command, some with others in a folder; nothing imports it.

Start at `main`: it finds the command's module, parses its arguments and maps errors to exit codes.
"""
