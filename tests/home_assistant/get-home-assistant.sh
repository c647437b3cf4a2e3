#!/usr/bin/env bash
# Installs the last Home Assistant for Python 3.11 into build/home-assistant, an environment of its own: it pins other
# versions than ours. Its schemas judge what we announce. Without it (no network, another Python) tests are skipped by
# name. Never fails, except in CI where Python is 3.11.
set -euo pipefail
cd "$(dirname "$0")/../.."

version=2024.3.3
target=build/home-assistant
if [ -e "$target/installed-$version" ] && "$target/bin/python" -c pass 2> /dev/null; then
    exit 0
fi
if ! .venv/bin/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then
    exit 0
fi
mkdir -p build
rm -rf "$target"
if .venv/bin/python -m venv "$target" \
    && timeout 600 "$target/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --only-binary :all: \
        --requirement tests/home_assistant/requirements.txt > build/home-assistant.log 2>&1; then
    touch "$target/installed-$version"
else
    rm -rf "$target"
    if [ "${CI:-}" = true ]; then
        cat build/home-assistant.log >&2
        echo "Home Assistant $version could not be installed." >&2
        exit 1
    fi
fi
