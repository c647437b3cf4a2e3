#!/usr/bin/env bash
# progress.sh LABEL COMMAND ..: runs a command quietly, and says each second for how long it has run; its output only when
# it fails. Sourced, it gives `with_progress`, which runs functions too.

with_progress() {
    local label=$1 seconds=0 log pid code=0 end='\n'
    shift
    log="$(mktemp)"
    [ -t 2 ] && end='\r' # on a terminal one line that counts
    "$@" > "$log" 2>&1 &
    pid=$!
    printf "%s ... %s s$end" "$label" "$seconds" >&2
    while sleep 1 && kill -0 "$pid" 2> /dev/null; do
        seconds=$((seconds + 1))
        printf "%s ... %s s$end" "$label" "$seconds" >&2
    done
    wait "$pid" || code=$?
    [ "$end" = '\n' ] || echo >&2
    [ "$code" = 0 ] || cat "$log" >&2
    rm -f "$log"
    return "$code"
}

if [ "${BASH_SOURCE[0]}" = "$0" ]; then
    with_progress "$@"
fi
