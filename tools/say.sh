# shellcheck shell=bash
# Sourced by the other tools: one line per stage; the output of a stage is shown only if it fails.

# stage LOG "What is done" COMMAND...
stage() {
    local log=$1 what=$2 start=$SECONDS
    shift 2
    mkdir -p "$(dirname "$log")"
    printf '%s ... ' "$what"
    if "$@" >"$log" 2>&1; then
        printf '%d s\n' $((SECONDS - start))
    else
        printf 'failed; the end of %s:\n' "$log"
        tail -n 30 "$log" | sed 's/^/    /'
        return 1
    fi
}

# refuse "Why, and what to do about it"
refuse() {
    printf '%s\n' "$*" >&2
    exit 1
}
