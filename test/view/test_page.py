"""What a visitor sees first: nothing that is wrong, then table and picture at once."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.model.prepared import load_model
from cdrj_ros.view.history import nothing_known
from cdrj_ros.view.page import Page
from cdrj_ros.view.panels import TimeAxis


def test_the_first_estimate_appears_in_table_and_picture_at_once() -> None:
    pytest.importorskip("viser")
    model = load_model("davinci_jaw")
    page = Page(model, "localhost", 0, "title", TimeAxis("t", 0.0, 1.0))
    try:
        assert page._table.content == "", "no estimate is not an invalid one"
        page.show(nothing_known(model), None, ())
        n = len(model.layout.elements)
        first = nothing_known(model)._replace(
            stamp_ns=1, tension=np.full(n, 14.9), stddev=np.full(n, 0.25),
            status=np.zeros(n, np.uint8),
        )  # fmt: skip
        page.show(first, None, ())
        assert page._table.content.count("14.9 ± 0.5 N") == n
        assert "INVALID" not in page._table.content
        (label,) = page.drawing._labels.values()
        assert label.text == f"{model.layout.elements[0]} 14.9 ± 0.5 N", "others would cover it"
    finally:
        page.close()
