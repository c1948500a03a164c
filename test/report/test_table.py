"""The table has the same content in a terminal and in a log file."""

import io

from cdrj_ros.evaluation.metrics import NO_SAMPLES, ChannelError
from cdrj_ros.report.table import errors_table, plain, print_errors, table_groups

ERRORS = {
    "effort/spindle": ChannelError(5, 0.00025, 0.021, 0.00041, 0.0012, 0.981),
    "tension/upper/7": ChannelError(5, 0.2, 0.004, 0.3, 1.0, 0.999),
    "tension/upper/8": ChannelError(5, 0.4, 0.008, 0.5, 2.5, 0.997),
    "nodal_force/upper/3": NO_SAMPLES,
}


def test_channels_are_grouped_by_quantity_with_their_mean_last():
    tension, force, effort = table_groups(ERRORS)
    assert [group.title for group in (tension, force, effort)] == [
        "Tension [N]",
        "Nodal force [N]",
        "Effort [mN·m]",
    ]
    assert [row.label for row in tension.rows] == ["upper/7", "upper/8"]
    assert tension.rows[1].cells == ("0.400", "0.80 %", "0.500", "2.500", "0.9970")
    assert tension.summary.label == "all elements"
    assert tension.summary.cells == ("0.300", "0.60 %", "0.400", "2.500", "0.9980")
    assert effort.summary is None
    assert effort.rows[0].cells == ("0.250", "2.10 %", "0.410", "1.200", "0.9810")


def test_names_are_not_markup():
    from rich.console import Console

    stream = io.StringIO()
    table = errors_table({"tension/[bold]a/1": ERRORS["tension/upper/8"]})
    Console(file=stream, width=100).print(table)
    assert "[bold]a/1" in stream.getvalue()


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_gets_a_drawn_table_and_a_file_plain_text(monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERM", "xterm")
    terminal, file, narrow = Terminal(), io.StringIO(), Terminal()
    for stream in (terminal, file):
        monkeypatch.setattr("sys.stdout", stream)
        print_errors(ERRORS)
    assert "─" in terminal.getvalue()
    assert file.getvalue() == plain(errors_table(ERRORS))
    assert "upper/8" in terminal.getvalue()
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setattr("sys.stdout", narrow)
    print_errors(ERRORS)
    assert narrow.getvalue() == plain(errors_table(ERRORS))


def test_many_channels_are_shown_by_the_worst_element_of_every_cable(capsys):
    relative = {
        f"tension/c{c}/{e}": 0.01 * ((7 * c + 3 * e) % 20) for c in range(20) for e in (1, 2)
    }
    many = {name: ChannelError(5, 0.1, value, 0.2, 0.5, 0.9) for name, value in relative.items()}
    many |= {f"effort/m{k}": ChannelError(5, 0.1, 0.1, 0.01 * k, 0.5, 0.9) for k in range(9)}
    print_errors(many, every=False)
    lines = capsys.readouterr().out.splitlines()
    shown = [name for line in lines if "/" in (name := line.split()[0])]
    worst = [
        max((f"c{c}/{e}" for e in (1, 2)), key=lambda name: relative[f"tension/{name}"])
        for c in range(20)
    ]
    assert sorted(shown) == sorted(worst)
    errors = [relative[f"tension/{name}"] for name in shown]
    assert errors == sorted(errors, reverse=True)
    assert [line.split()[0] for line in lines if line.startswith("  m")] == [
        "m8", "m7", "m6", "m5", "m4",
    ]  # fmt: skip
    assert "all elements" in "".join(lines)
    assert "--all prints all 49 channels" in "".join(lines)
    print_errors(many)
    assert len(capsys.readouterr().out.splitlines()) > len(many)
