"""Names of the compared quantities and their places in the estimate."""

from pathlib import Path

from cdrj_ros.evaluation.channels import QUANTITIES, quantity_of
from cdrj_ros.messages.cdr import REFERENCE_ARRAYS
from cdrj_ros.model.channels import channel_columns
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import load_robot

ROBOT = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"


def test_every_channel_has_its_own_column_in_the_order_of_the_standard_deviations() -> None:
    layout = prepare(load_robot(ROBOT)).layout
    columns = channel_columns(layout)
    assert list(columns) == [
        *(f"tension/{name}" for name in layout.elements),
        *(f"nodal_force/{name}" for name in layout.pulleys),
        *(f"effort/{name}" for name in layout.motors + layout.joints),
    ]
    assert len(set(columns.values())) == len(columns)
    assert columns["tension/upper/8"] == layout.tension.start + 7
    assert columns["effort/elbow"] == layout.joint_effort.start


def test_recorded_and_estimated_channels_have_the_same_prefixes() -> None:
    estimated = {quantity_of(name) for name in channel_columns(prepare(load_robot(ROBOT)).layout)}
    assert {prefix for prefix, _ in REFERENCE_ARRAYS.values()} == estimated
    assert estimated <= set(QUANTITIES)
