"""Files of this repository that many tests read."""

from pathlib import Path

import yaml

from cdrj_ros.robot.reader import parse_robot

ROOT = Path(__file__).parents[2]
ROBOTS = ROOT / "config" / "robots"
PROTOTYPE = ROBOTS / "prototype.yaml"
ROBOT = str(PROTOTYPE)
SAMPLE = ROOT / "bags" / "prototype_preload_36_26"


def shipped_once(name):
    """A shipped robot in which every part is used once, for tests that would be slow otherwise."""
    path = ROBOTS / f"{name}.yaml"
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    for part in document.get("parts", ()):
        del part["used"][1:]
    return parse_robot(yaml.safe_dump(document), str(path))


ROS = (
    "rclpy", "cdrj_msgs", "sensor_msgs", "std_msgs", "std_srvs", "diagnostic_msgs",
    "rosgraph_msgs", "rcl_interfaces", "builtin_interfaces", "lifecycle_msgs",
    "visualization_msgs", "ament_index_python", "launch",
)  # fmt: skip
"""Modules of ROS, which the rooms but ``nodes`` do without."""
