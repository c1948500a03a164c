#!/usr/bin/env bash
# Build a core that stops at an invalid address, at undefined behaviour and at a wrong index, or run the tests of
# the conditioning with it. Called by `make sanitize` and `make test`.
#
#   tools/sanitize.sh build | test
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/say.sh
. tools/env.sh

made=build/sanitized
flags="-fsanitize=address,undefined -fno-sanitize-recover=all -fno-wrapv -fno-omit-frame-pointer -D_GLIBCXX_ASSERTIONS"

build() {
    # Of the first two variables, setuptools takes the first for C++ or, in older versions, the second.
    CXXFLAGS=$flags CFLAGS=$flags LDFLAGS="-fsanitize=address,undefined" \
        python setup.py build_ext --build-temp "$made/objects" --build-lib "$made"
    grep -q __asan_init "$made"/cdrj_ros/_core.*.so
}

if [ "$1" = build ]; then
    stage build/sanitize.log "Building the core with sanitizers" build
    exit
fi

# A tree of links to the package, with this core.
tree=$made/tree
rm -rf "$tree"
mkdir -p "$tree"
cp -as "$PWD/cdrj_ros" "$tree/"
find "$tree" -name '*.so' -delete
cp "$made"/cdrj_ros/_core.*.so "$tree/cdrj_ros/"

# Python itself keeps memory until it ends.
export ASAN_OPTIONS=detect_leaks=0
LD_PRELOAD=$(c++ -print-file-name=libasan.so) PYTHONPATH=$tree:${PYTHONPATH:-} \
    pytest -q -p no:cacheprovider test/conditioning
