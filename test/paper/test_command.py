"""The commands of examples/paper: outputs, refusals, and Ctrl-C."""

import re

import numpy as np
import pytest
from support.places import PROTOTYPE

from cdrj_ros.robot.description import Pulley
from cdrj_ros.robot.reader import load_robot
from examples.paper import __main__ as paper
from examples.paper import equations

PNG = b"\x89PNG\r\n\x1a\n"


def _one_line(capsys, *words):
    error = capsys.readouterr().err
    assert error.startswith("paper: ")
    assert error.count("\n") == 1
    for word in words:
        assert word in error


def test_the_command_writes_every_figure_and_the_tables(tmp_path, capsys, monkeypatch):
    from examples.paper import figures

    monkeypatch.setattr(figures, "STYLE", {**figures.STYLE, "savefig.dpi": 40})
    out = tmp_path / "new" / "folder"
    assert paper.main(["--out", str(out), "--quick"]) == 0
    for name in figures.DRAWINGS:
        assert (out / f"{name}.png").read_bytes().startswith(PNG)
    printed = capsys.readouterr().out
    text = (out / "tables.md").read_text()
    for heading in ("Table I:", "Table II:", "Errors:"):
        assert heading in printed
        assert f"## {heading}" in text
    assert "1.34 N, 13.65 %" in printed
    assert "diameter [mm]" in printed


@pytest.mark.parametrize("name", ["tables.md", "fig09_rho.png"])
def test_earlier_results_are_replaced_only_with_force(tmp_path, capsys, monkeypatch, name):
    monkeypatch.setattr(paper, "work", lambda *_, **__: pytest.fail("ran before the refusal"))
    (tmp_path / name).write_text("kept")
    (tmp_path / "other.txt").write_text("kept")
    assert paper.main(["--out", str(tmp_path)]) == 2
    _one_line(capsys, f"{name} exists already; --force replaces it")
    assert (tmp_path / name).read_text() == "kept"
    with pytest.raises(pytest.fail.Exception, match="ran before"):
        paper.main(["--out", str(tmp_path), "--force"])


def test_the_equations_hold_on_the_sample_bag(capsys):
    with np.printoptions():
        equations.main()
    text = capsys.readouterr().out
    # (25)-(28): K is symmetric only without friction
    gaps = dict(re.findall(r"eta (\S+): K - K\^T is (\S+) of K", text))
    assert float(gaps["1.0"]) < 1e-12
    assert float(gaps["0.9"]) > 1e-2
    # (22): the tensions propagated from one load cell agree with the other load cells
    (sliding,) = re.findall(r"every pulley slides in (\d+) samples", text)
    assert int(sliding) > 500
    errors = re.findall(r"^(upper/\d): mean error (\S+) N, largest (\S+) N$", text, re.MULTILINE)
    assert [name for name, _, _ in errors] == [f"upper/{k}" for k in range(1, 9)]
    assert all(float(mean) < 0.05 and float(largest) < 0.25 for _, mean, largest in errors)
    # (44): rho equals the value with which the bag was simulated
    (found,) = re.findall(r"rho of upper, \(44\): (\S+)", text)
    cable = load_robot(PROTOTYPE).cables[0]
    (true,) = {node.friction.rho for node in cable.nodes if isinstance(node, Pulley)}
    assert abs(float(found) - true) < 0.01
