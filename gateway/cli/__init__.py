"""The command line: one module, or one folder, for each command; nothing imports it.

Start at `main`: it finds the command's module, parses its arguments and maps errors to exit codes.
"""
