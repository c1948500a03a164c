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

# As many jobs as processors. Otherwise colcon also limits the load, and a machine with other work compiles
# one file after the other.
export MAKEFLAGS=-j$(nproc)
# Messages are encoded and decoded as fast as with -O3, which takes longer to compile.
optimised="-O1 -DNDEBUG"
# Started by the environment's Python, colcon gives the installed executables that Python too.
stage "build/colcon-$1.log" "Building $1" \
    python "$(command -v colcon)" build \
    --base-paths . msg_defs/cdrj_msgs --packages-select "$1" --symlink-install \
    --cmake-args -DCMAKE_BUILD_TYPE=Release \
    "-DCMAKE_C_FLAGS_RELEASE=$optimised" "-DCMAKE_CXX_FLAGS_RELEASE=$optimised" \
    "-DPython3_EXECUTABLE=$VIRTUAL_ENV/bin/python"
