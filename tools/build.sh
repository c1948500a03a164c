#!/usr/bin/env bash
# Build one of the two packages with colcon into install/. Called by `make setup`.
#
#   tools/build.sh PACKAGE
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/say.sh
. tools/env.sh

# Remove files that are no longer among the sources.
rm -rf "install/$1"

# Started by the environment's Python, colcon gives the installed executables that Python too.
stage "build/colcon-$1.log" "Building $1" \
    python "$(command -v colcon)" build \
    --base-paths . msg_defs/cdrj_msgs --packages-select "$1" --symlink-install \
    --cmake-args -DCMAKE_BUILD_TYPE=Release "-DPython3_EXECUTABLE=$VIRTUAL_ENV/bin/python"
