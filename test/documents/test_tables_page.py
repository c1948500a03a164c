"""docs/tables.md: its programs and its command run, and print what the page shows."""

import shlex

import numpy as np
from support.page_lines import blocks

from cdrj_ros.commands import validate


def test_the_programs_and_the_command_of_the_page_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = "docs/tables.md"
    scope = {}
    for program in blocks(page, "python"):
        exec(program, scope)  # noqa: S102
    assert capsys.readouterr().out == blocks(page, "text")[0]
    assert (tmp_path / "tensions.png").stat().st_size > 10_000
    log = scope["log"]
    log = {**log, "m1_cur": np.zeros(log["t_s"].size)}
    np.savetxt("log.csv", np.column_stack(list(log.values())), delimiter=",",
               header=",".join(log), comments="")  # fmt: skip
    (tmp_path / "columns.yaml").write_text(blocks(page, "yaml")[0])
    (line,) = blocks(page)
    assert validate.main(shlex.split(line)[1:]) == 0
    assert "upper/8" in capsys.readouterr().out
