"""Every record of the core, with all of its fields in their order, is a type of rows in Python."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.model import packing
from cdrj_ros.model.packing import RECORDS

CORE = Path(packing.__file__).parents[1] / "core"
WORDS = {
    "Vector3": 3,
    "Matrix3": 9,
    "std::array<double, 3>": 3,
    "std::array<double, CAPACITY>": 64,
}


def declared() -> dict[str, list[tuple[str, int]]]:
    """Fields of every record and how many words each has."""
    text = "".join((CORE / name).read_text() for name in ("robot_records.hpp", "state_records.hpp"))
    text = re.sub(r"//[^\n]*", "", text)
    found = {}
    for name, body in re.findall(r"struct (\w+) \{(.*?)\n\};", text, flags=re.DOTALL):
        fields = re.findall(r"^\s*([\w:<>, ]+?) (\w+);", body, flags=re.MULTILINE)
        found[name] = [(field, WORDS.get(kind, 1)) for kind, field in fields]
    return found


def test_every_record_of_the_core_is_an_array_of_the_model() -> None:
    assert declared().keys() == RECORDS.keys()


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_of_the_core_has_the_fields_of_the_array(name: str) -> None:
    record = RECORDS[name]
    fields = [(field, record[field].itemsize // 8) for field in record.names]
    assert declared()[name] == fields
    assert not any(hasattr(np.record, field) for field in record.names), "hidden by NumPy's own"
