"""Robots of some fingers, with as many cables as wanted, beside each other or on a wrist."""

import numpy as np
import yaml

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.model.following import following_motors
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot
from support.compared import each


def finger(name, parent="base", cables=2):
    """Two joints in a row; the first cable ends beyond both, the others beyond the first one."""
    frames = [
        {"name": f"{name}_near", "motion": "revolute", "joint": f"{name}_mcp"},
        {"name": f"{name}_far", "motion": "revolute", "joint": f"{name}_pip",
         "parent": f"{name}_near", "origin": [0.045, 0.0]},
    ]  # fmt: skip
    if parent != "base":
        frames[0]["parent"] = parent
    found = {"motors": [], "frames": frames, "cables": []}
    found["joints"] = [{"name": f"{name}_{one}", "range": [0.0, 1.0]} for one in ("mcp", "pip")]
    for k in range(cables):
        found["motors"].append({"name": f"{name}_motor{k}"})
        end = f"{name}_far" if k == 0 else f"{name}_near"
        found["cables"].append(cable(f"{name}_{k}", f"{name}_motor{k}", end, k))
    return found


def cable(name, motor, frame, k):
    """A cable from a drum of its own to a frame, over a pulley of 8 mm at the axis of a joint."""

    def pulley(radius, position, turn, at="base"):
        bearing = {"bearing_diameter": 0.003, "frame": at}
        return {"type": "pulley", "radius": radius, "position": position, "turn": turn, **bearing}

    nodes = [
        {"type": "winch", "motor": motor, "winding": 1, "radius": 0.006,
         "position": [-0.09, -0.02 - 0.01 * k], "turn": "cw"},
        pulley(0.004, [-0.022, -0.01], "ccw"),
        pulley(0.008, [0.0, 0.0], "cw"),
    ]  # fmt: skip
    if frame.endswith("_far"):
        near = frame.replace("_far", "_near")
        nodes += [
            pulley(0.004, [0.022, -0.01], "ccw", near),
            pulley(0.006, [0.045, 0.0], "cw", near),
        ]
    nodes.append({"type": "anchor", "frame": frame, "position": [0.022, -0.012]})
    return {"name": name, "axial_stiffness": 15000.0, "preload": 12.0, "nodes": nodes}


def hand(*fingers, **more):
    whole = {
        "name": "hand",
        "friction": {"mu_c": 0.1, "rho": 0.3, "bearing_friction": 0.005},
    }
    for part in (more, *fingers):
        for key, entries in part.items():
            whole[key] = whole.get(key, []) + entries
    return parse_robot(yaml.safe_dump(whole, sort_keys=False))


WRIST = {
    "joints": [{"name": "wrist", "range": [-0.5, 0.5]}],
    "frames": [{"name": "palm", "motion": "revolute", "joint": "wrist"}],
}

EPOCH_NS = 1_700_000_000_000_000_000
STAMPS = EPOCH_NS + 20_000_000 * np.arange(200)


def recorded(robot):
    """Four seconds of joints to and fro, with efforts that fit the file but for noise."""
    time = (STAMPS - STAMPS[0]) * 1e-9
    angles = np.outer(0.3 - 0.3 * np.cos(3.0 * time), np.ones(len(robot.joints)))
    model = prepare(robot)
    samples = Samples(STAMPS, following_motors(model, angles), angles)
    values = run(model, initial_state(model), samples)[1].values
    efforts = {}
    for motor, column in zip(robot.motors, values[:, model.layout.motor_effort].T, strict=True):
        noise = np.random.default_rng(sum(map(ord, motor.name))).normal(0.0, 0.005, time.size)
        efforts[f"effort/{motor.name}"] = column + noise
    motors, joints = (
        each(STAMPS, dict(zip((axis.name for axis in axes), table.T, strict=True)))
        for axes, table in ((robot.motors, samples.motor_angle), (robot.joints, angles))
    )
    return Recorded("motion", motors, joints, each(STAMPS, efforts))
