#!/usr/bin/env bash
# Build a core that stops at an invalid address, at undefined behaviour and at a wrong index, or run the tests of
# the core with it. Called by `make sanitize` and `make test`.
#
#   tools/sanitize.sh build | test
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/say.sh
. tools/env.sh

made=build/sanitized

# What only binds the core to Python takes twice as long with checks of undefined behaviour.
compile() {
    local checks=address,undefined
    case $1 in */bind*) checks=address ;; esac
    c++ -c "$1" -o "$made/objects/$(basename "$1").o" -std=c++20 -O1 -g -fPIC -fvisibility=hidden -ffp-contract=off \
        -fsanitize=$checks -fno-sanitize-recover=all -D_GLIBCXX_ASSERTIONS $includes
}

build() {
    includes=$(python -c 'if True:
        import nanobind, numpy, sysconfig
        own = nanobind.include_dir()
        folders = own, nanobind.source_dir(), own + "/../ext/robin_map/include", numpy.get_include(), sysconfig.get_path("include")
        print(*("-I" + folder for folder in folders))')
    export made includes
    export -f compile
    rm -rf "$made"
    mkdir -p "$made/objects"
    printf '%s\n' cdrj_ros/core/*.cpp | xargs -P "$(nproc)" -I {} bash -c 'compile {}' || return
    c++ -shared -fsanitize=address,undefined "$made"/objects/*.o -o "$made/_core$(python -c 'import sysconfig; print(sysconfig.get_config_var("EXT_SUFFIX"))')"
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
cp "$made"/_core.*.so "$tree/cdrj_ros/"

# Python itself keeps memory until it ends. It does not load the C++ library by itself, whose exceptions
# the sanitizer has to know at the start.
export ASAN_OPTIONS=detect_leaks=0
LD_PRELOAD="$(c++ -print-file-name=libasan.so) $(c++ -print-file-name=libstdc++.so)" PYTHONPATH=$tree:${PYTHONPATH:-} \
    pytest -q -p no:cacheprovider test/messages/test_cdr.py \
        test/estimation/test_{beliefs,conditioner,core_ensemble,time_line,time_line_properties,tracking}.py
