"""Print the JSON Schema of the configuration."""

from __future__ import annotations

import argparse
import json

from gateway.config import Config


def add_arguments(_parser: argparse.ArgumentParser) -> None:
    """Add none."""


def run(_args: argparse.Namespace) -> int:
    """Print the schema; TOML's tables are JSON's objects."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Config.model_json_schema(),
        "title": "Configuration of Starter Gateway",
    }
    print(json.dumps(schema, indent=2))
    return 0
