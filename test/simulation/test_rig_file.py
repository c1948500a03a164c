"""Rig files: the shipped ones, what every key sets, and messages for invalid ones."""

import json
import re
from dataclasses import fields, replace
from pathlib import Path

import pytest
from support.places import ROOT

import cdrj_ros.simulation
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.prepared import load_model
from cdrj_ros.simulation.drives import drive_limits
from cdrj_ros.simulation.faults import KINDS, Freeze, Slip, Snap, wire
from cdrj_ros.simulation.rig_file import LoadChoice, RigDescription, load_rig, parse_rig
from cdrj_ros.simulation.sensors import (
    JOINT_ENCODER,
    MOTOR_ENCODER,
    CellGroup,
    LoadCells,
    SensorSettings,
    encoder_groups,
)

SHIPPED = sorted(path.stem for path in (ROOT / "config" / "rigs").glob("*.yaml"))


def test_the_default_is_the_ideal_rig():
    assert load_rig("ideal") == load_rig("") == RigDescription()


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_file_suits_the_prototype(name):
    rig, model = load_rig(name), load_model("prototype")
    assert encoder_groups(model, rig.sensors, 0)
    CellGroup(model, rig.sensors, 0)
    wire(model.robot, rig.faults)
    drive_limits(model.robot, 1000.0, **rig.drives)


def test_every_key_sets_what_it_says():
    rig = parse_rig("""
    motors: {counts: 100, rate: 10, phase: 0.1, noise: 0.2, bias_deg: 90, jitter: 0.3, dropout: 0.4,
             latency: 0.6}
    joints: {counts: 200}
    motor_efforts: {noise: 0.7}
    load_cells: {elements: [upper/8, lower/1], rate: 20, noise: 0.8, bias: 0.9, jitter: 0.01,
                 dropout: 0.02, latency: 0.04}
    references: {noise: 1.1, bias: 1.2}
    load: {kind: lift, payload: 2, gravity: -3, damping: 4, stops: [-1, 1]}
    drives: {max_speed: 1, max_acceleration: 6, max_torque: 2, rotor_inertia: 3, rotor_damping: 4,
             command_timeout: 5}
    faults:
      - {kind: snap, at: 20, cable: lower, amount_mm: 3}
      - {kind: freeze, at: 7, encoder: elbow}
      - {kind: slip, at: 1}
    ros2_control: {update_rate: 250}
    """)
    quarter = 1.5707963267948966
    assert rig == RigDescription(
        SensorSettings(
            replace(
                MOTOR_ENCODER, counts=100, rate=10.0, phase=0.1, noise=0.2, bias=quarter,
                jitter=0.3, dropout=0.4, latency=0.6,
            ),
            replace(JOINT_ENCODER, counts=200),
            0.7,
            ("upper/8", "lower/1"),
            LoadCells(
                rate=20.0, noise=0.8, bias=0.9, jitter=0.01, dropout=0.02, latency=0.04,
            ),
            LoadCells(noise=1.1, bias=1.2),
            250.0,
            (Freeze(7.0, "elbow"),),
        ),
        LoadChoice("lift", 2, -3, 4, (-1.0, 1.0)),
        {"max_speed": 1, "max_acceleration": 6, "max_torque": 2, "rotor_inertia": 3,
         "rotor_damping": 4, "command_timeout": 5},
        (Snap(20.0, 0.003, "lower"), Slip(1.0)),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1]", "must hold a mapping with sensors, drives, load or faults"),
        ("sensor: {}", "sensor is not a known key; there are drives, faults"),
        ("motors: {count: 3}", "motors.count is not a known key; did you mean counts?"),
        ("motors: {noise: -1}", "motors.noise must be at least 0, got -1"),
        ("motors: {noise: .nan}", "motors.noise must be a finite number"),
        ("joints: {counts: 10.5}", "joints.counts must be of type integer, got 10.5"),
        ("load_cells: {}", "load_cells.elements is missing: Elements with a cell"),
        ("load: {kind: feather}", "load.kind must be one of rolling, pendulum, lift, got"),
        ("faults: [{kind: rust, at: 3}]", "faults[0].kind must be one of slack, snap, slip"),
        ("faults: [{kind: snap}]", "faults[0].at is missing: Time from the start"),
        ("faults: [{kind: snap, at: 3, amount: 5}]", "the amount of snap must be in (0, 1], got 5"),
        ("faults: [{kind: freeze, at: 3}]", "faults[0]: freeze takes encoder"),
        ("faults: [{kind: slip, at: 3, encoder: a}]", "faults[0]: slip takes amount and"),
        ("ros2_control: {update_rate: 0}", "ros2_control.update_rate must be at least 1, got 0"),
    ],
)  # fmt: skip
def test_a_mistake_is_explained_by_the_key(text, words):
    with pytest.raises(CdrjError, match=re.escape(words)):
        parse_rig(text)


SCHEMA = json.loads((Path(cdrj_ros.simulation.__file__).parent / "rig.schema.json").read_text())


def test_the_schema_has_every_fault():
    entry = SCHEMA["properties"]["faults"]["items"]["properties"]
    assert entry["kind"]["enum"] == list(KINDS)
    assert set(entry) - {"kind", "at"} == {
        field.name for kind in KINDS.values() for field in fields(kind) if field.name != "begin"
    }


def test_the_page_lists_every_key():
    page = (ROOT / "docs" / "simulation.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", page, re.MULTILINE)
    listed = {section: set(re.findall(r"`(\w+)`", keys)) for section, keys in rows}

    def keys_of(rules):
        if "$ref" in rules:
            rules = SCHEMA["$defs"][rules["$ref"].rpartition("/")[2]]
        return set(rules.get("items", rules)["properties"])

    wanted = {name: keys_of(rules) for name, rules in SCHEMA["properties"].items()}
    assert {name: listed[name] for name in wanted} == wanted
