"""The physical model for one sample: from angles and friction history to tensions."""

import sys

if "coverage" not in sys.modules:
    # numba imports it for a measurement of coverage, which cannot be running then.  Where colcon is
    # installed, so is coverage, and every start would take 50 ms longer.
    sys.modules["coverage"] = None  # type: ignore[assignment]
    try:
        import numba  # noqa: F401
    finally:
        del sys.modules["coverage"]
