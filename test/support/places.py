"""Files of this repository that many tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
ROBOTS = ROOT / "config" / "robots"
PROTOTYPE = ROBOTS / "prototype.yaml"
ROBOT = str(PROTOTYPE)
SAMPLE = ROOT / "bags" / "prototype_preload_36_26"
