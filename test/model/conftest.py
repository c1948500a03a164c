"""Fixtures: the prototype, its variants and motions."""

from dataclasses import replace

import numpy as np
import pytest
from support.places import PROTOTYPE

from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.robot.description import Pulley
from cdrj_ros.robot.reader import load_robot

EPOCH_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="session")
def prototype():
    """The robot of the source, Tables I and II."""
    return load_robot(PROTOTYPE)


@pytest.fixture(scope="session")
def variant(prototype):
    """The prototype with another friction law, other friction or other preloads."""

    def make(law="elastoplastic", preloads=None, **friction):
        def with_friction(cable, preload):
            nodes = tuple(
                replace(node, friction=replace(node.friction, **friction))
                if isinstance(node, Pulley)
                else node
                for node in cable.nodes
            )
            return replace(cable, nodes=nodes, law=law, preload=preload)

        chosen = preloads or tuple(cable.preload for cable in prototype.cables)
        cables = map(with_friction, prototype.cables, chosen)
        return replace(prototype, cables=tuple(cables))

    return make


@pytest.fixture(scope="session")
def drive():
    """Samples of one motor and one joint at given times [s]."""

    def make(time, motor, joint):
        stamps = EPOCH_NS + np.round(np.asarray(time) * 1e9).astype(np.int64)
        return Samples(
            stamps,
            np.array(motor, dtype=np.float64)[:, None],
            np.array(joint, dtype=np.float64)[:, None],
        )

    return make
