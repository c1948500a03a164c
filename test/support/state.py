"""The parts of a state by name: ``State`` of the core, whose values are opaque to the package."""

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import Views, views
from cdrj_ros.model.prepared import Model


def state_views(model: Model, state: Vector) -> Views:
    """Named views of the parts of a state.

    Args:
        model: the robot.
        state: shape (state_size,), or (states, state_size), and the views then have the same first
            axis.
    """
    return views("State", model.topology, state)
