"""Random faults of drivers for the campaign: one of each kind."""

import numpy as np

from support.campaign_draws import SECONDS
from support.driver_faults import (
    frozen,
    in_degrees,
    messages_of,
    older,
    second,
    twice,
)

HERTZ = 200
"""Messages of both axes per second [Hz]."""

NAMES = ("winch", "elbow")


def _axis(generator):
    return NAMES[generator.integers(0, 2)]


def _value(generator):
    """A wrong angle [rad] of either sign, as often in every decade."""
    return float(generator.choice((-1.0, 1.0)) * 10.0 ** generator.uniform(-3.0, -0.5))


def _begin(generator):
    """Time from which a second publisher sends [s]: the start in half of the runs."""
    return float(generator.choice((0.0, generator.uniform(0.35, 0.8) * SECONDS)))


def _frozen(generator):
    begin = float(generator.uniform(0.35, 0.8)) * SECONDS
    lasting = float(10.0 ** generator.uniform(-0.5, 1.0))
    return frozen(begin, begin + lasting, (NAMES, NAMES[:1], NAMES[1:])[generator.integers(0, 3)])


DRIVERS = {
    "old values with new stamps": _frozen,
    "equal stamps, the wrong value first": lambda g: second(_value(g), begin_s=_begin(g)),
    "equal stamps, the wrong value last": lambda g: second(
        _value(g), first=False, begin_s=_begin(g)
    ),
    "a name twice, the wrong value first": lambda g: twice(_axis(g), _value(g)),
    "a name twice, the wrong value last": lambda g: twice(_axis(g), _value(g), first=False),
    "values of a message 5 to 30 ms apart": lambda g: older(_axis(g), int(g.integers(1, 7))),
    "one axis in degrees": lambda g: in_degrees((_axis(g),)),
    "both axes in degrees": lambda _: in_degrees(NAMES),
}
"""Every kind, by the name of its row."""


def messages(model, course, kind, seed):
    """Messages of both axes of the prototype with a fault of a kind."""
    generator = np.random.default_rng([seed, list(DRIVERS).index(kind), 77])
    return DRIVERS[kind](generator)(messages_of(model, course, HERTZ))
