"""The parts of a state by name: ``State`` of the core, whose values are opaque to the package."""

from functools import lru_cache

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import Part, Sizes, Views, part, views


@lru_cache
def _state_parts(sizes: Sizes) -> dict[str, Part]:
    """The first parts of a state: ``State`` of the core."""
    segments, contacts = part(sizes.contacts + sizes.cables), part(sizes.contacts)
    axes = part(sizes.motors + sizes.joints)
    return {
        "started": part(1),
        "length": segments,
        "material": segments,
        "delayed": segments,
        "bristle": contacts,
        "slip_speed": contacts,
        "lagged_speed": contacts,
        "place": contacts,
        "track": part(sizes.pulleys),
        "covered": part(sizes.surfaces),
        "angle": axes,
        "bearing_friction": axes,
        "drums": part(sizes.drums, record="Drum"),
    }


def state_views(sizes: Sizes, state: Vector) -> Views:
    """Named views of the parts of a state.

    Args:
        sizes: of the robot.
        state: shape (state_size,) or longer; in Python also (states, state_size), and the views
            then have the same first axis.
    """
    return views(state, _state_parts(sizes))
