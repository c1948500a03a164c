"""Equations of the paper on the sample bag: stiffness matrix, propagated tensions, rho.

Equation numbers are those of examples/paper/derivation.md.

    python3 -m examples.paper.equations
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np

from cdrj_ros.foundation.arrays import Series, Vector
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.recordings.recording import Recording, read_recording
from examples.paper.propagation import KnownTension, Path, identify_rho, path_of, propagate
from examples.paper.stiffness import Stiffness, nominal_stiffness, stiffness_matrix

SAMPLE_BAG = FilePath(__file__).resolve().parents[2] / "bags" / "prototype_preload_36_26"
CABLE, SENSOR, PULLEY = "upper", "upper/8", "upper/3"
NOISE = 0.02  # standard deviation of the load cells [N]


def stiffness(model: Model, transmission: float) -> Stiffness:
    """(25)-(28): K of the upper cable at its preload, every pulley with the same transmission.

    (28) holds for any arrangement of the nodes. The prototype's file gives lengths but no
    positions, so the cable is laid out in the plane, turning by every pulley's wrap angle.
    """
    cable = model.robot.cables[model.layout.cables.index(CABLE)]
    course = path_of(model, np.array([1]), np.zeros((1, 1))).course
    columns = [model.layout.elements.index(name) for name in cable.element_names]
    length = course.length[0, columns]
    wrap = course.wrap[0, [model.layout.pulleys.index(name) for name in cable.pulley_names]]
    heading = np.concatenate([[0.0], np.cumsum(wrap)])
    steps = length[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    position = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    tension = np.full(length.size, cable.preload)
    k = nominal_stiffness(cable.axial_stiffness, length)
    eta, direction = np.full(wrap.size, transmission), np.full(wrap.size, -1.0)
    return stiffness_matrix(position, tension, k, k, eta, direction)


def recorded(recording: Recording, model: Model) -> tuple[Path, Callable[[str], Vector]]:
    """Path of the motion at the stamps of the load cells, and a function that gives a reading."""
    stamps = recording.references[f"tension/{SENSOR}"].stamp_ns
    origin = stamps[0]

    def at(series: Series) -> Vector:
        """Values of a series at the stamps."""
        read: Vector = np.interp(stamps - origin, series.stamp_ns - origin, series.value)
        return read

    joint = np.column_stack([at(recording.joints[name]) for name in model.layout.joints])
    return path_of(model, stamps, joint), lambda name: at(recording.references[name])


def main() -> None:
    """Print the results for stiffness, tensions and rho."""
    np.set_printoptions(linewidth=100, precision=1, suppress=True)
    model = load_model("prototype")
    for eta in (1.0, 0.9):
        k = stiffness(model, eta)
        gap = np.abs(k.matrix - k.matrix.T).max() / np.abs(k.matrix).max()
        print(f"K of {CABLE}, (28), {k.matrix.shape}, eta {eta}: K - K^T is {gap:.1e} of K")
        print(f"K_ss of (26) [N/m]:\n{k.slip_by_slip}")

    path, reading = recorded(read_recording(SAMPLE_BAG), model)
    known = KnownTension(SENSOR, reading(f"tension/{SENSOR}"), NOISE)
    found = propagate(model, path, known)
    sliding = (found.sliding != 0).all(axis=1)
    print(f"Tensions from {SENSOR}, (22): every pulley slides in {sliding.sum()} samples")
    for column, name in enumerate(found.elements):
        error = np.abs(found.tension[:, column] - reading(f"tension/{name}"))[sliding]
        print(f"{name}: mean error {error.mean():.3f} N, largest {error.max():.3f} N")

    rho = identify_rho(model, path, known, PULLEY, reading(f"nodal_force/{PULLEY}"))
    print(f"rho of {CABLE}, (44): {rho.rho:.4f} +- {rho.stddev:.1e} from {rho.samples} samples")


if __name__ == "__main__":
    main()
