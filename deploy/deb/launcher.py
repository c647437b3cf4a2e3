#!/usr/bin/python3 -IS
"""Starter Gateway, of the version in force; nothing else that Python may find on this machine counts."""

# PYTHON_ARGCOMPLETE_OK
import os
import sys

TREE = "/usr/lib/starter-gateway/current"

sys.path.insert(0, TREE)
os.environ.update(PYTHONPATH=TREE, PYTHONSAFEPATH="1")  # for processes of its own: python3 -m gateway ..

from gateway.cli.main import main  # noqa: E402 - its place is known only now

sys.exit(main())
