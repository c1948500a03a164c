"""Energy of the load of the rig."""

import numpy as np


def energy(load, angle, speed):
    """Sum of kinetic and gravitational energy [J], zero at rest at q = 0; shape (n,)."""
    inertia = load.inertia + load.inertia_cos * np.cos(angle)
    turning = load.weight_cos * np.sin(angle) + 0.5 * load.weight_cos_2 * np.sin(2.0 * angle)
    return 0.5 * inertia * speed**2 + load.weight * angle + turning
