"""Mend the include folders that the ROS wheels export.

The exported CMake files of the message packages contain the Python and NumPy include folders of the
machine that built the wheels. CMake rejects an include folder that does not exist, so a message
package cannot be built against these wheels until the paths name this environment's headers.
Running the script again changes nothing.
"""

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

PYTHON_HEADERS = re.compile(r"/opt/python/cp3\d+-cp3\d+/include/python3\.\d+")
NUMPY_HEADERS = re.compile(r"/opt/python/cp3\d+-cp3\d+/[^;\"]*/numpy/(_core|core)/include")


def mend(text):
    """Replace the include folders of the build machine by those of this environment."""
    text = NUMPY_HEADERS.sub(lambda _: np.get_include(), text)
    return PYTHON_HEADERS.sub(lambda _: sysconfig.get_path("include"), text)


def main():
    """Mend the files below share/ of the current environment."""
    for path in Path(sys.prefix, "share").glob("*/cmake/*Export.cmake"):
        text = path.read_text()
        if (mended := mend(text)) != text:
            path.write_text(mended)


if __name__ == "__main__":
    main()
