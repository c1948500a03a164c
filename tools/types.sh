#!/usr/bin/env bash
# Check the types, in the project's environment. Called by `make check` and `make test`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# The types of NumPy before 2.3 differ so much from later ones that no code satisfies both. Python
# 3.10 (NumPy 2.2) and Ubuntu 24.04 (1.26) have such versions; there the code is tested, but its types
# are not checked.
numpy=$(python -c 'import numpy; print(numpy.__version__)')
case $numpy in
    1.* | 2.[0-2].*) echo "mypy: skipped, the types of NumPy $numpy are too old" ;;
    *) mypy ;;
esac
