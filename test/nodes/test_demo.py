"""The demonstration of `make demo`, on a short recording."""

import re
import signal
from pathlib import Path

import pytest
from support.page_lines import loaded_tool
from support.places import ROOT


@pytest.fixture
def signals_as_before():
    """The demonstration ends its nodes on signals that end the process."""
    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for one, handler in before.items():
        signal.signal(one, handler)


@pytest.mark.usefixtures("signals_as_before")
def test_the_demonstration_names_no_file_that_it_has_deleted(short_bag, tmp_path, capfd):
    demo = loaded_tool(
        ROOT / "tools" / "demo.py", BAG=short_bag, MEASURED=tmp_path / "measured.json",
        REPORT=str(tmp_path / "report.html"), FIGURES=str(tmp_path / "report.json"),
    )  # fmt: skip
    assert demo.main([]) == 0
    named = re.findall(r"^(?:figures|report): (\S+)$", capfd.readouterr().out, re.MULTILINE)
    assert sorted(named) == [demo.REPORT, demo.FIGURES]
    assert all(Path(name).exists() for name in named)
    assert demo.MEASURED.exists()
