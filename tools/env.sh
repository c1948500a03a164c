# shellcheck shell=bash
# Source this in bash to work in the project's environment: `. tools/env.sh`. Afterwards Python and
# pytest find ROS 2 and both packages, and the package's executables are on the path.

# The settings that colcon and ROS write use variables that may not be set.
case $- in *u*) _cdrj_nounset=1 ;; *) _cdrj_nounset= ;; esac
set +u

_cdrj_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export VIRTUAL_ENV=$_cdrj_root/.venv
export PATH=$VIRTUAL_ENV/bin:$PATH
# Set by some containers; every process would then compile the source of all packages that it imports, for 1.5 s.
unset PYTHONDONTWRITEBYTECODE
if [ -e "$VIRTUAL_ENV/share/rclpy" ]; then
    # ROS 2 is in .venv and must not be mixed with another installation.
    export AMENT_PREFIX_PATH=$VIRTUAL_ENV CMAKE_PREFIX_PATH=$VIRTUAL_ENV
    unset PYTHONPATH PYTHONHOME COLCON_PREFIX_PATH RMW_IMPLEMENTATION
    LD_LIBRARY_PATH=$VIRTUAL_ENV/lib
    for _cdrj_libs in "$VIRTUAL_ENV"/lib/python3.*/site-packages/ros_*.libs; do
        LD_LIBRARY_PATH=$LD_LIBRARY_PATH:$_cdrj_libs
    done
    export LD_LIBRARY_PATH
    # The wheels start Python a second time to set these paths, unless told that they are set.
    export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
fi
if [ -e "$_cdrj_root/install/local_setup.bash" ]; then
    . "$_cdrj_root/install/local_setup.bash"
fi
export PATH=$_cdrj_root/install/cdrj_ros/lib/cdrj_ros:$PATH

if [ "$_cdrj_nounset" ]; then set -u; fi
unset _cdrj_root _cdrj_libs _cdrj_nounset
