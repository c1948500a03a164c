"""What is wrong with the readings of one axis of a hand is said of the cables that lead over it."""

import numpy as np
import pytest
import yaml
from support.campaign import MS, START
from support.driver_faults import Message, feed, frozen, older, twice
from support.fingers import finger, hand

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.following import following_motors
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

JOINT, MOTOR, OWN = "a_mcp", "a_motor0", 8
"""Axes of the first finger, and the number of its elements."""
COUNT, BEGIN, GAP = 400, 200, 60
"""Messages, the first one that is wrong, and the messages of a gap."""


@pytest.fixture(scope="module")
def five():
    """Five fingers that are exactly known."""
    document = dict(hand(*(finger(name) for name in "abcde")).document)
    known = {**document, "uncertainty": {"others": "exact"}}
    return prepare(parse_robot(yaml.safe_dump(known, sort_keys=False)))


def moved(five, resting=0):
    """Messages of all axes at 200 Hz; each joint moves at a frequency of its own.

    The last joints rest from their first turn on.
    """
    time, angles = 0.005 * np.arange(COUNT), []
    for k in range(10):
        frequency = 0.7 + 0.05 * k
        since = np.minimum(time, 0.5 / frequency) if k >= 10 - resting else time
        angles.append(0.3 - 0.25 * np.cos(2.0 * np.pi * frequency * since))
    table = np.stack(angles, axis=1)
    rows = np.hstack([following_motors(five, table), table]).tolist()
    names = (*five.layout.motors, *five.layout.joints)
    return [Message(START + 5 * k * MS, names, tuple(row)) for k, row in enumerate(rows)]


@pytest.fixture(scope="module")
def messages(five):
    """All joints move."""
    return moved(five)


def changed(name, change):
    """The readings of one axis become ``change`` of them and of the message's number."""

    def spoil(messages):
        place, found = messages[0].names.index(name), []
        for k, message in enumerate(messages):
            positions = list(message.positions)
            positions[place] = change(positions[place], k)
            found.append(message._replace(positions=tuple(positions)))
        return found

    return spoil


def left_out(messages):
    """One joint is missing in the messages of a gap, and counts anew after it."""
    place, zero = (
        messages[0].names.index(JOINT),
        dict(zip(*messages[BEGIN + GAP][1:], strict=True))[JOINT],
    )
    anew = changed(JOINT, lambda angle, k: angle - zero * (k >= BEGIN))(messages)
    lacking = [one._replace(names=one.names[:place] + one.names[place + 1 :],
                            positions=one.positions[:place] + one.positions[place + 1 :])
               for one in anew[BEGIN : BEGIN + GAP]]  # fmt: skip
    return anew[:BEGIN] + lacking + anew[BEGIN + GAP :]


FAULTS = {
    "frozen": frozen(0.005 * BEGIN, axes=[JOINT]),
    "two values": twice(JOINT, 0.5),
    "old": older(MOTOR, 8),
    "half of the angle": changed(JOINT, lambda angle, _: 0.5 * angle),
    "a step": changed(MOTOR, lambda angle, k: angle + 0.4 * (k > BEGIN)),
    "two publishers": changed(JOINT, lambda angle, k: angle + 0.2 * (k > BEGIN and k % 2)),
    "a gap": left_out,
}


def digits(outputs):
    """Status, tensions and standard deviations of the other fingers, by stamp."""
    return {
        one.stamp_ns: [part[OWN:40].tobytes() for part in (one.status, one.tension, one.stddev)]
        for one in outputs
    }


@pytest.fixture(scope="module")
def clean(five, messages):
    """The estimates from messages without a fault."""
    return feed(five, messages)


@pytest.mark.parametrize("what", FAULTS)
def test_a_wrong_axis_of_a_finger_changes_no_digit_of_the_others(what, five, messages, clean):
    assert len(five.layout.elements) == 40
    expected, outputs = digits(clean), feed(five, FAULTS[what](messages))
    found = digits(outputs)
    assert len(found) > 0.8 * COUNT
    assert all(expected[stamp] == one for stamp, one in found.items())
    last = outputs[-GAP:]
    assert np.mean([one.status[OWN:] == 0 for one in last]) > 0.9
    assert np.mean([one.status[:OWN] == 0 for one in last]) < 0.1


def test_what_sensors_say_beside_it_is_in_doubt_for_its_finger_alone(five, messages, clean):
    """What efforts say of the second cable of a finger follows from the estimate of the first."""

    def heard(messages):
        live, found = LiveEstimator(five), []
        for message, at in zip(messages, clean, strict=True):
            efforts = at.values[five.layout.motor_effort]
            live.feed_efforts(message.stamp_ns, five.layout.motors, efforts)
            found += live.feed("both", message.stamp_ns, message.names, message.positions)[1]
        return found

    right = heard(messages)
    wrong = heard(frozen(0.005 * BEGIN, axes=[MOTOR])(messages))
    assert digits(right) == digits(wrong)
    assert np.mean([one.status[:OWN] == 0 for one in right[-GAP:]]) > 0.9
    assert all((one.status[:OWN] != 0).all() for one in wrong[-GAP:])


@pytest.mark.parametrize("what", ["frozen", "a gap"])
def test_in_a_recording_neither(what, five, messages, clean):
    expected = digits(clean)

    def read(name):
        there = [one for one in FAULTS[what](messages) if name in one.names]
        stamps = np.array([one.stamp_ns for one in there])
        values = np.array([one.positions[one.names.index(name)] for one in there])
        return Series(stamps, stamps, values)

    motors, joints = ({one: read(one) for one in names}
                      for names in (five.layout.motors, five.layout.joints))  # fmt: skip
    found = estimate(five, condition(five.robot, motors, joints), uncertainty=True)
    assert np.mean(found.status[-GAP:, :OWN] == 0) < 0.1
    for k, stamp in enumerate(found.stamp_ns.tolist()):
        own = [part[k, OWN:40].tobytes() for part in (found.status, found.tension, found.stddev)]
        assert own == expected[stamp]


def test_a_finger_at_rest_is_in_doubt_too_where_the_driver_of_all_hangs(five):
    """It repeats its last message: one finger was in motion then, the others rested."""
    right = moved(five, resting=8)
    hung = right[:BEGIN] + [one._replace(positions=right[BEGIN].positions) for one in right[BEGIN:]]
    assert all((one.status == 0).all() for one in feed(five, right)[-GAP:])
    assert all((one.status != 0).all() for one in feed(five, hung)[-GAP:])


def test_a_break_of_the_run_leaves_all_axes_unseen_although_some_were_read_in_a_gap(five, messages):
    """The motors of a come back first, and pause; those of b slipped while nobody looked."""

    def slipped(message, only=""):
        read = {name: angle + 0.008 * (name == "b_motor0")
                for name, angle in zip(message.names, message.positions, strict=True)
                if name.startswith(only)}  # fmt: skip
        return message._replace(names=tuple(read), positions=tuple(read.values()))

    def resumed(early):
        live = LiveEstimator(five)
        for one in messages[:BEGIN]:
            live.feed("both", one.stamp_ns, one.names, one.positions)
        live.suspend()
        later = [slipped(one) for one in messages[BEGIN + GAP + 60 :]]
        found = []
        for one in [slipped(one, "a_motor") for one in early] + later:
            found += live.feed("both", one.stamp_ns, one.names, one.positions)[1]
        return found[-1].stddev[OWN : 2 * OWN]

    plain, paused = resumed([]), resumed(messages[BEGIN + 30 : BEGIN + 40])
    np.testing.assert_allclose(paused, plain, rtol=0.05)
