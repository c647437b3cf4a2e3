#!/usr/bin/env bash
# Fetches what judges the Sparkplug node from outside into build/sparkplug: from npm sparkplug-payload, as
# npm/package-lock.json beside this has it, and into a venv of its own mqtt-spb-wrapper (a host application, which needs
# an older paho) and tahu. What cannot be had is left out, and its tests are skipped by name.
# Never fails.
set -euo pipefail
cd "$(dirname "$0")/../../.."

lock=tests/end_to_end/sparkplug/npm/package-lock.json
target=build/sparkplug
mkdir -p "$target"

by_npm() {
    local folder="$target/npm"
    [ -e "$folder/package-lock.json" ] && cmp --quiet "$lock" "$folder/package-lock.json" && [ -d "$folder/node_modules" ] && return 0
    command -v npm > /dev/null && command -v node > /dev/null || return 1
    mkdir -p "$folder"
    cp tests/end_to_end/sparkplug/npm/package.json "$folder/"
    cp "$lock" "$folder/"
    npm ci --prefix "$folder" --ignore-scripts --no-audit --no-fund --loglevel=error > /dev/null || { rm -rf "$folder"; return 1; }
}

by_pip() {
    local venv="$target/venv"
    [ -e "$venv/.installed" ] && "$venv/bin/python" -c pass 2> /dev/null && return 0
    rm -rf "$venv"
    .venv/bin/python -m venv "$venv" || return 1
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
        'mqtt-spb-wrapper==2.1.2' 'paho-mqtt==1.6.1' 'protobuf==3.20.3' || return 1
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps 'tahu==0.1.2' || return 1
    touch "$venv/.installed"
}

missing=""
by_npm || missing="$missing sparkplug-payload(npm)"
by_pip || missing="$missing mqtt-spb-wrapper"
if [ -n "$missing" ]; then
    echo "Not fetched, so their tests of Sparkplug are skipped:$missing" >&2
fi
