#!/usr/bin/env bash
# Build one of the two packages with colcon into install/, or compile the kernels. Called by `make`.
#
#   tools/build.sh cdrj_msgs | cdrj_ros | kernels
#
# The numerical kernels need the core, but neither ROS nor the messages. The core is compiled first, beside the
# sources, where the build of cdrj_ros finds it. The kernels of every start are compiled while the messages are
# built, the others afterwards, or while `make demo` plays.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/say.sh
. tools/env.sh

later() { printf 'What needs the kernels compiles them.\n'; }
compile_kernels() { python -m cdrj_ros.commands.compile_ahead --missing "$@"; }

if [ "$1" = kernels ]; then
    stage build/kernels.log "Compiling the other numerical kernels" compile_kernels || later
    exit
fi

# Remove files that are no longer among the sources.
rm -rf "install/$1"

# As many jobs as processors. Otherwise colcon also limits the load, and a machine with other work compiles
# one file after the other.
export MAKEFLAGS=-j$(nproc)
# Messages are encoded and decoded as fast as with -O3, which takes longer to compile.
optimised="-O1 -DNDEBUG"

# ROS 2 as wheels has no rclcpp, so no C++ node could include the messages.
without_cpp=OFF
if [ -e "$VIRTUAL_ENV/share/rclpy" ]; then without_cpp=ON; fi

# Started by the environment's Python, colcon gives the installed executables that Python too.
build() {
    python "$(command -v colcon)" build \
        --base-paths . msg_defs/cdrj_msgs --packages-select "$1" --symlink-install \
        --cmake-args -DCMAKE_BUILD_TYPE=Release "-DWITHOUT_CPP=$without_cpp" \
        "-DCMAKE_C_FLAGS_RELEASE=$optimised" "-DCMAKE_CXX_FLAGS_RELEASE=$optimised" \
        "-DPython3_EXECUTABLE=$VIRTUAL_ENV/bin/python"
}

export CDRJ_KERNELS=later
if [ "$1" != cdrj_msgs ]; then
    stage "build/colcon-$1.log" "Building $1" build "$1"
    exit
fi

build_core() { python setup.py build_ext --inplace --build-temp build/core; }
stage build/core.log "Compiling the core" build_core
compile_kernels --start >build/kernels.out 2>&1 &
kernels=$!
# The processes that it has started end with it.
trap 'kill "$kernels" 2>/dev/null || true' EXIT

rest_of_kernels() {
    local failed=0
    wait "$kernels" || failed=$?
    cat build/kernels.out
    return "$failed"
}

stage "build/colcon-$1.log" "Building $1" build "$1"
stage build/kernels.log "Compiling the numerical kernels of every start" rest_of_kernels || later
