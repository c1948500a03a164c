"""The JSON file contains the exact figures and never NaN."""

import json

import numpy as np
import pytest

from cdrj_ros.commands.shared import FORMAT, VERSION, results, write_results
from cdrj_ros.evaluation.channels import BagComparison, Channel
from cdrj_ros.evaluation.metrics import FIGURES, errors_of, pooled_errors


def refuse(constant):
    raise AssertionError(f"{constant} in JSON")


def constant_channel(n):
    zeros = np.zeros(n)
    stamps = np.arange(n, dtype=np.int64)
    return Channel("effort/spindle", "N·m", stamps, zeros, zeros, np.full(n, np.nan), "")


def test_figures_survive_the_file_bit_for_bit(tmp_path, comparison):
    path = tmp_path / "figures.json"
    bags = errors_of([comparison, comparison])
    write_results(path, bags)
    read = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    assert read == results(bags)
    assert set(read) == {"format", "version", "bags", "all", "limits"}
    assert (read["format"], read["version"]) == (FORMAT, VERSION)
    assert read["limits"] is None
    for bag in read["bags"]:
        keys = "path duration_s channels friction counters notes facts health"
        assert set(bag) == set(keys.split())
    for channels, errors in (
        (read["bags"][0]["channels"], pooled_errors([comparison])),
        (read["all"]["channels"], pooled_errors([comparison, comparison])),
    ):
        assert list(channels) == list(errors)
        for name, figures in channels.items():
            assert set(figures) == {"unit", "n", *FIGURES}
            assert figures["n"] == errors[name].n
            for figure in FIGURES:
                assert figures[figure] == getattr(errors[name], figure)
    assert read["all"]["channels"]["effort/spindle"]["unit"] == "N·m"
    assert read["bags"][0]["counters"]["motor sample not finite"] == 3


@pytest.mark.parametrize("n", [0, 1, 5])
def test_undefined_figures_are_null(tmp_path, n):
    path = tmp_path / "figures.json"
    write_results(path, errors_of([BagComparison("a", float("nan"), (constant_channel(n),))]))
    read = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    figures = read["all"]["channels"]["effort/spindle"]
    assert figures["n"] == n
    assert figures["r2"] is None
    assert figures["mean_relative_error"] is None
    assert read["bags"][0]["duration_s"] is None
