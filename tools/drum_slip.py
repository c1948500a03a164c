#!/usr/bin/env python3
"""Let `identify` judge whether the cable slips on its drum, on rigs where it does and does not.

python tools/drum_slip.py             print the ratios behind docs/identification.md
python tools/drum_slip.py --draws 6   the same with more recordings

The truths have eight contact cells per pulley; their numbers are drawn as in standard_errors.py.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any, Final

import numpy as np
from standard_errors import SECONDS, fitted_numbers, moved, recording, robot_file, truths

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.problem import Settings
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.assembly import divide_contacts

CELLS: Final = 8
CHOICES: Final = {
    "all but forces on pulleys": (),
    "element 8 of both cables": ("tension/*/8",),
    "effort of the motor": ("effort/winch",),
}


def rig(document: Any, values: dict[str, float], seed: int, *, slips: bool) -> Recorded:
    """A recording of a rig whose drum holds, or has no memory; along the same motion."""
    robot = build_robot(with_numbers(document, values), "truth")
    recorded = recording(document, values, seed)
    motion = moved(robot, seed, SECONDS, np.random.default_rng([seed, 1]))
    angles = (motion.truth.motor_angle, motion.truth.joint_angle)
    samples = Samples(motion.stamp_ns, *map(np.ascontiguousarray, angles))
    fine = prepare(divide_contacts(robot, CELLS))
    found = run(fine, initial_state(fine), samples, slipping=slips)[1].values
    tension = found[::2, fine.layout.tension]
    columns = {f"tension/{n}": t for n, t in zip(fine.layout.elements, tension.T, strict=True)}
    columns["effort/winch"] = found[::2, fine.layout.motor_effort][:, 0]
    columns["effort/elbow"] = found[::2, fine.layout.joint_effort][:, 0]
    stamps = np.ascontiguousarray(samples.stamp_ns[::2])
    generator = np.random.default_rng([seed, 2])
    references = {}
    for name, column in columns.items():
        noise = 5e-4 if name.startswith("effort/") else 0.02
        read = column + generator.normal(0.0, noise, stamps.size)
        references[name] = Series(stamps, stamps, read)
    return replace(recorded, references=references)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=3)
    draws = parser.parse_args().draws
    document = robot_file()
    unknowns = fitted_numbers(document, "rho,preload")
    print("| references | drum | what the new file says |")
    print("|---|---|---|")
    for what, channels in CHOICES.items():
        settings = Settings(channels=channels, coarse=True, compares_drums=True)
        for slips in (False, True):
            said = []
            for seed, values in enumerate(truths(document, unknowns, "all", draws)):
                recorded = rig(document, values, seed, slips=slips)
                found = identify(document, "file", unknowns, [recorded], settings).drums
                assert found is not None
                said.append(f"{found.drums}: {found.comment}")
            truth = "without memory" if slips else "holds"
            print(f"| {what} | {truth} | {'; '.join(said)} |", flush=True)


if __name__ == "__main__":
    main()
