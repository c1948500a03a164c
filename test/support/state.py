"""The parts of a state by name: ``State`` of the core, whose values are opaque to the package."""

from cdrj_ros.model.packing import parts_of, views


def state_views(sizes, state):
    """Named views of the parts of a state.

    Args:
        sizes: of the robot.
        state: shape (state_size,); in Python also (states, state_size), and the views then have the
            same first axis.
    """
    return views(state, parts_of(sizes)["state"])
