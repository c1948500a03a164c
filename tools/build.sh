#!/usr/bin/env bash
# Build one of the two packages with colcon into install/. Called by `make`.
#
#   tools/build.sh cdrj_msgs | cdrj_ros
#
# The core is compiled first, beside the sources, where the build of cdrj_ros finds it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/say.sh
. tools/env.sh

# Remove files that are no longer among the sources. What was generated of a message that went would
# also stay in the build, and be linked.
rm -rf "install/$1"
if [ "$1" = cdrj_msgs ]; then rm -rf "build/$1"; fi

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

build_core() { python setup.py build_ext --inplace --build-temp build/core; }

if [ "$1" = cdrj_ros ]; then stage build/core.log "Compiling the core" build_core; fi
stage "build/colcon-$1.log" "Building $1" build "$1"
