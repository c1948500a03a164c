#!/usr/bin/env bash
# Rewrite requirements/constraints.txt with the newest versions that the requirements allow, if possible
# the same for all supported versions of Python. Needs `uv` on the path.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../requirements"

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cp build.txt ros.txt runtime.txt dev.txt mujoco.txt docs.txt "$scratch"
# uv reads the platforms to resolve for from a project file; it is needed for nothing else.
cat >"$scratch/pyproject.toml" <<'END'
[project]
name = "constraints"
version = "0"
requires-python = ">=3.10"
[tool.uv]
environments = ["sys_platform == 'linux' and platform_machine == 'x86_64' and implementation_name == 'cpython' and python_version < '3.14'"]
END
(cd "$scratch" && uv pip compile --quiet --universal --python-version 3.10 --no-header --no-annotate \
    --output-file pinned.txt build.txt ros.txt runtime.txt dev.txt mujoco.txt docs.txt)

{
    echo "# Every version that is installed, for Python 3.10 to 3.13. Written by \`make lock\`."
    # The supported platforms are checked at set-up; their markers on every line would only hide
    # the ones that differ.
    sed -E "s/ and (implementation_name|platform_machine|sys_platform|platform_python_implementation) [!=]= '[^']*'//g
            s/ and python_full_version < '3\.14'//
            s/ ; python_full_version < '3\.14'$//" "$scratch/pinned.txt"
} >constraints.txt
