"""Mend the include folders that the ROS wheels export.

The CMake files of the message packages name the Python and NumPy headers of the machine that built
the wheels. CMake refuses to use an include folder that does not exist, so no message package can be
built against these wheels before they name the headers of this environment. Safe to run again.
"""

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

PYTHON_HEADERS = re.compile(r"/opt/python/cp3\d+-cp3\d+/include/python3\.\d+")
NUMPY_HEADERS = re.compile(r"/opt/python/cp3\d+-cp3\d+/[^;\"]*/numpy/(_core|core)/include")


def mend(text: str) -> str:
    """Point every include folder of the builder's machine to this environment's."""
    text = NUMPY_HEADERS.sub(lambda _: np.get_include(), text)
    return PYTHON_HEADERS.sub(lambda _: sysconfig.get_path("include"), text)


def main() -> None:
    """Mend the files below share/ of the environment this runs in."""
    for path in Path(sys.prefix, "share").glob("*/cmake/*Export.cmake"):
        text = path.read_text()
        if (mended := mend(text)) != text:
            path.write_text(mended)


if __name__ == "__main__":
    main()
