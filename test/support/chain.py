"""One cable from a winch over equal pulleys to an anchor."""

import numpy as np

from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Anchor, Cable, Friction, Motor, Profile, Pulley, Robot, Winch

DRUM = 0.015
"""Radius of the winch [m]."""
WRAP = 2.0
"""Total wrap of all pulleys [rad]; while sliding, the far end keeps 74 % of the tension."""


def _constant(value):
    empty = np.empty(0)
    return (Profile(None, empty, np.array([value]), empty),)


def chain(pulleys, stiffness, length=1.0):
    """A cable of this length [m], whose pulleys have this bristle stiffness [N/m] each."""
    friction = Friction(mu_c=0.15, mu_s=0.2, stribeck_speed=0.05, bristle_stiffness=stiffness)
    pulley = Pulley(0.01, friction, wrap=_constant(WRAP / pulleys))
    cable = Cable(
        "chain",
        6283.0,
        30.0,
        (Winch((("winch", 1.0),), DRUM, 1), *[pulley] * pulleys, Anchor()),
        (_constant(length / (pulleys + 1)),) * (pulleys + 1),
    )
    return prepare(Robot("chain", (Motor("winch"),), (), (cable,)))
