"""What drivers are known to send never leaves a wrong tension with status 0.

The truth is the rig of the file, so that even small errors count.
"""

from functools import cache

import numpy as np
import pytest
from support.campaign import MS, SECOND, START, course_of, judge
from support.driver_faults import (
    Message,
    bunched,
    feed,
    frozen,
    in_degrees,
    late_stamps,
    messages_of,
    older,
    repeated,
    scaled,
    second,
    slipping,
    swapped,
    twice,
    zeroed,
)
from support.places import ROBOTS

from cdrj_ros.estimation.model_error import load_share
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.model.prepared import load_model
from cdrj_ros.simulation import motion

LAW = 0.001
"""Greatest share of tensions with status 0 beyond five standard deviations."""
BEGIN_S = 3.0
"""Time at which readings freeze: the joints are at speed [s]."""
BEGIN = round(BEGIN_S) * SECOND


@pytest.fixture(scope="module", params=["prototype", "finger", "wrist"])
def robot(request, tmp_path_factory):
    """A robot whose numbers are exact where its file states nothing else."""
    text = (ROBOTS / f"{request.param}.yaml").read_text(encoding="utf-8")
    if "uncertainty:" not in text:
        text += "\nuncertainty: {others: exact}\n"
    path = tmp_path_factory.mktemp("robots") / f"{request.param}.yaml"
    path.write_text(text, encoding="utf-8")
    return load_model(str(path))


def swing(model, hertz=0.3):
    """Sinusoids of all joints through most of their ranges."""

    def angle(time):
        columns = []
        for k, joint in enumerate(model.robot.joints):
            centre = 0.5 * (joint.lower + joint.upper)
            amplitude = 0.35 * (joint.upper - joint.lower)
            columns.append(centre + motion.sine(amplitude, hertz * (1.0 + 0.13 * k))(time))
        return np.column_stack(columns)

    return angle


@pytest.fixture(scope="module")
def courses(robot):
    """By the frequency of the swing [Hz]."""
    return cache(lambda hertz: course_of(robot, 6.0, swing(robot, hertz)))


@pytest.fixture(scope="module")
def course(courses):
    return courses(0.3)


def test_stamps_of_publication_keep_status_0(robot, course):
    """Readings are even although their stamps are not."""
    messages = late_stamps(0.0003)(messages_of(robot, course, 200))
    verdict = judge(course, feed(robot, messages), 2 * SECOND)
    assert verdict.ratio.size > 0.9 * verdict.judged
    assert verdict.beyond(5.0) <= LAW


@pytest.mark.parametrize("hertz", [1000, 200])
def test_messages_that_arrive_in_bunches_show_no_step_and_no_impossible_speed(
    hertz, robot, courses
):
    lives = []
    messages = bunched(0.01)(messages_of(robot, courses(1.0), hertz))
    outputs = feed(robot, messages, watch=lambda live, _: lives.append(live))
    assert not any(lives[-1].conditioner.refused.values())
    assert lives[-1].conditioner.steps == 0
    verdict = judge(courses(1.0), outputs, 2 * SECOND)
    assert verdict.ratio.size > 0.9 * verdict.judged


def test_sensors_read_less_often_than_published_are_no_second_publisher(robot, course):
    named = []
    messages = repeated(2)(messages_of(robot, course, 1000))
    outputs = feed(
        robot, messages, watch=lambda live, _: named.append(live.conditioner.alternating)
    )
    assert judge(course, outputs).beyond(5.0) <= LAW
    assert not any(named)


def first_joint(model):
    return model.robot.joints[0].name


@pytest.mark.parametrize("which", ["joint", "motor", "motors"])
def test_lags_within_a_message_are_in_the_standard_deviations(which, robot, course):
    """From the start, whether a lag makes the mean tension rise or fall first."""
    names = {"joint": [first_joint(robot)], "motor": names_of(robot, "motors")[:1]}
    good = beyond = 0.0
    for older_ms in (5, 10, 20, 30):
        messages = messages_of(robot, course, 200)
        for name in names.get(which) or names_of(robot, which):
            messages = older(name, older_ms // 5)(messages)
        verdict = judge(course, feed(robot, messages))
        assert older_ms > 10 or verdict.beyond(5.0) <= LAW
        good += verdict.ratio.size
        beyond += verdict.ratio.size * verdict.beyond(2.0)
    assert beyond <= 0.06 * good


def test_lags_of_joints_that_oppose_each_other_at_their_fastest_add_up_later(robot, course):
    if len(robot.robot.joints) != 2:
        pytest.skip("two joints, which turn at different rates")
    messages = messages_of(robot, course, 200)
    for name in names_of(robot, "joints"):
        messages = older(name, 4)(messages)
    assert judge(course, feed(robot, messages)).beyond(5.0) <= LAW


@pytest.mark.parametrize("which", ["joint", "motor"])
def test_a_slow_axis_that_lags_by_a_tenth_of_a_second_is_unsure_before_a_tension_is_wrong(
    which, robot, courses
):
    axis = first_joint(robot) if which == "joint" else names_of(robot, "motors")[0]
    messages = older(axis, 20)(messages_of(robot, courses(0.1), 200))
    assert judge(courses(0.1), feed(robot, messages)).beyond(5.0) <= LAW


def test_a_lag_that_no_driver_should_have_takes_status_0_away(robot, course):
    messages = older(first_joint(robot), 20)(messages_of(robot, course, 200))
    assert judge(course, feed(robot, messages), 4500 * MS).beyond(5.0) <= LAW


@pytest.mark.parametrize("hertz", [1000, 200, 50])
def test_a_clean_stream_keeps_status_0_and_is_called_nothing(hertz, robot, course):
    def watch(live, _message):
        found = live.conditioner
        assert found.stuck == found.alternating == live.misfitting == []

    verdict = judge(course, feed(robot, messages_of(robot, course, hertz), watch=watch), 2 * SECOND)
    assert verdict.ratio.size > 0.7 * verdict.judged
    assert verdict.beyond(5.0) <= LAW


@pytest.mark.parametrize("hertz", [1000, 200, 50])
@pytest.mark.parametrize("mode", ["wait", "predict"])
def test_old_readings_with_new_stamps_make_everything_unsure_within_50_ms(
    mode, hertz, robot, course
):
    named = set()
    messages = frozen(BEGIN_S)(messages_of(robot, course, hertz))
    options = Options(conditioning=mode)  # type: ignore[arg-type]
    outputs = feed(robot, messages, options, lambda live, _: named.update(live.conditioner.stuck))
    assert judge(course, outputs, BEGIN + 50 * MS).ratio.size == 0
    assert judge(course, outputs).beyond(5.0) <= LAW
    assert named & {axis.name for axis in robot.robot.motors}


@pytest.mark.parametrize("noise", [1e-7, 1e-5])
def test_noise_below_the_errors_of_a_reading_makes_old_ones_no_newer(noise, robot, course):
    messages = frozen(BEGIN_S, noise=noise)(messages_of(robot, course, 200))
    outputs = feed(robot, messages)
    assert judge(course, outputs, BEGIN + 50 * MS).ratio.size == 0
    assert judge(course, outputs).beyond(5.0) <= LAW


@pytest.mark.parametrize("by", [0.003, 0.01])
@pytest.mark.parametrize("every", [1, 5])
def test_a_second_publisher_with_stamps_of_its_own_is_found_without_a_stated_resolution(
    every, by, robot, course
):
    messages = []
    for k, message in enumerate(messages_of(robot, course, 200)):
        messages.append(message)
        if k % every == 0:
            other = tuple(angle + by for angle in message.positions)
            messages.append(Message(message.stamp_ns + 2 * MS, message.names, other))
    assert judge(course, feed(robot, messages)).beyond(5.0) <= LAW


def test_old_readings_of_a_slow_joint_are_found_although_few_counts_are_missed(robot):
    """At 1 kHz a joint of 60 mrad/s shows a new count with every sixth reading."""
    slow = course_of(robot, 6.0, swing(robot, 0.1))
    messages = frozen(BEGIN_S, axes=[first_joint(robot)])(messages_of(robot, slow, 1000))
    outputs = feed(robot, messages)
    assert judge(slow, outputs, BEGIN + 100 * MS).ratio.size == 0
    assert judge(slow, outputs).beyond(5.0) <= LAW


@pytest.mark.parametrize(("by", "readings"), [(0.02, 3), (0.1, 3), (0.1, 10)])
@pytest.mark.parametrize("which", ["joints", "motors"])
def test_a_slip_over_several_readings_leaves_no_wrong_tension_with_status_0(
    which, by, readings, robot, courses
):
    axis = names_of(robot, which)[0]
    messages = slipping(axis, BEGIN_S, by, readings / 200)(messages_of(robot, courses(1.0), 200))
    assert judge(courses(1.0), feed(robot, messages)).beyond(5.0) <= LAW


@pytest.mark.parametrize("lasting", [0.3, 1.5])
def test_readings_that_are_old_for_a_while_leave_no_history_that_is_taken_for_known(
    lasting, robot, course
):
    """The way of the axes meanwhile is unknown, and with it the friction."""
    messages = frozen(BEGIN_S, BEGIN_S + lasting)(messages_of(robot, course, 200))
    found = []
    outputs = feed(robot, messages, watch=lambda live, _: found.append(live))
    assert judge(course, outputs).beyond(5.0) <= LAW
    assert found[-1].conditioner.stuck == []
    assert found[-1].conditioner.displaced == {}, "nor is it taken for a step of a sensor"


@pytest.mark.parametrize("which", ["motors", "joints"])
@pytest.mark.parametrize(
    ("hertz", "gap_s"), [(0.1, 0.1), (0.1, 0.5), (0.3, 0.3), (0.3, 1.2), (0.3, 2.0)]
)
def test_an_axis_that_counts_anew_after_a_gap_has_the_difference_as_standard_deviation(
    gap_s, hertz, which, robot, courses
):
    """However short: what it was zeroed by shows in the mean tensions."""
    messages = messages_of(robot, courses(hertz), 200)
    for axis in names_of(robot, which):
        outputs = feed(robot, zeroed([axis], BEGIN_S, gap_s)(messages))
        assert judge(courses(hertz), outputs, BEGIN).beyond(5.0) <= LAW


@pytest.mark.parametrize("gap_s", [0.3, 1.2])
def test_axes_that_all_count_anew_after_a_gap_are_in_doubt_although_tensions_do_not_show_it(
    gap_s, robot, course
):
    messages = zeroed(course.names, BEGIN_S + 0.4, gap_s)(messages_of(robot, course, 200))
    assert judge(course, feed(robot, messages), BEGIN).beyond(5.0) <= LAW


@pytest.mark.parametrize(("hertz", "gap_s"), [(0.3, 0.3), (0.3, 1.5), (1.0, 0.5), (1.0, 0.7)])
def test_a_gap_in_motion_keeps_status_0(gap_s, hertz, robot, courses):
    course = courses(hertz)
    messages = messages_of(robot, course, 200)
    begin, end = round(200 * BEGIN_S), round(200 * (BEGIN_S + gap_s))
    outputs = feed(robot, messages[:begin] + messages[end:])
    verdict = judge(course, outputs, BEGIN)
    assert verdict.ratio.size > 0.9 * verdict.judged
    assert verdict.beyond(5.0) <= LAW


def test_a_gap_of_one_topic_leaves_no_doubt_of_what_was_between_its_readings(robot, course):
    """The line between them differs from the motion, which the mean tensions show there."""
    motors = len(robot.robot.motors)
    live, outputs = LiveEstimator(robot), []
    for message in messages_of(robot, course, 200):
        stamp_ns, names, positions = message
        outputs += live.feed("joints", stamp_ns, names[motors:], positions[motors:])[1]
        if not BEGIN <= stamp_ns - START < BEGIN + 300 * MS:
            outputs += live.feed("motors", stamp_ns, names[:motors], positions[:motors])[1]
    verdict = judge(course, outputs, BEGIN + 500 * MS)
    assert verdict.ratio.size > 0.9 * verdict.judged
    assert judge(course, outputs).beyond(5.0) <= LAW


@pytest.mark.parametrize("hertz", [200, 50])
@pytest.mark.parametrize("comes_first", [True, False])
@pytest.mark.parametrize("how", ["equal stamps", "names twice"])
def test_two_values_for_one_time_contradict_each_other_whichever_comes_first(
    how, comes_first, hertz, robot, course
):
    joint = first_joint(robot)
    fault = second(first=comes_first)
    if how == "names twice":
        fault = twice(joint, first=comes_first)
    named = []
    messages = fault(messages_of(robot, course, hertz))
    outputs = feed(
        robot, messages, watch=lambda live, _: named.append(live.conditioner.alternating)
    )
    assert judge(course, outputs).beyond(5.0) <= LAW
    assert judge(course, outputs, SECOND).ratio.size == 0
    assert joint in named[-1]


def test_equal_stamps_with_equal_values_change_nothing(robot, course):
    messages = messages_of(robot, course, 200)
    once = feed(robot, messages)
    again = feed(robot, [one for message in messages for one in (message, message)])
    assert [one.values.tobytes() for one in once] == [one.values.tobytes() for one in again]


def test_a_late_reading_that_is_off_the_line_of_earlier_ones_contradicts_them(robot, course):
    """Two publishers with equal stamps, of which one is always a message behind."""
    messages = messages_of(robot, course, 200)
    zeros = [one._replace(positions=(0.0,) * len(one.names)) for one in messages]
    pairs = zip(zeros[1:], messages[:-1], strict=True)
    live = []
    late = [one for pair in pairs for one in pair]
    outputs = feed(robot, late, watch=lambda one, _: live.append(one))
    assert judge(course, outputs, SECOND).ratio.size == 0
    assert first_joint(robot) in live[-1].conditioner.alternating
    honest = [one for two in zip(messages[1::2], messages[::2], strict=True) for one in two]
    feed(robot, honest, watch=lambda one, _: live.append(one))
    assert live[-1].conditioner.alternating == [], "those that are only late do not"


def test_repeated_messages_do_not_keep_an_estimate_from_going_on_after_a_gap(robot, course):
    messages = messages_of(robot, course, 200)
    doubled = [one for message in messages[:200] + messages[600:] for one in (message, message)]
    outputs = feed(robot, doubled)
    assert outputs[-1].stamp_ns == messages[-1].stamp_ns


def names_of(model, which):
    motors = [axis.name for axis in model.robot.motors]
    joints = [axis.name for axis in model.robot.joints]
    return {"motors": motors, "joints": joints, "both": motors + joints}[which]


@pytest.mark.parametrize("hertz", [200, 50])
@pytest.mark.parametrize("which", ["motors", "joints", "both"])
@pytest.mark.parametrize("share", [1.0, 0.02])
def test_angles_in_degrees_are_unsure_before_a_tension_is_wrong(share, which, hertz, robot, course):
    """Whether the readings leave the range, or a small motion keeps them within it."""
    if which == "both" and robot.robot.motors[0].sensor.resolution == 0.0:
        pytest.skip("counts tell the unit, and their size is not stated")
    small = course._replace(angle=course.angle[0] + share * (course.angle - course.angle[0]))
    around_zero = small._replace(angle=small.angle - small.angle[0])
    messages = messages_of(robot, around_zero, hertz)
    named = set()
    outputs = feed(
        robot, in_degrees(names_of(robot, which))(messages),
        watch=lambda live, _: named.update(live.misfitting),
    )  # fmt: skip
    clean = feed(robot, messages)
    expected = {one.stamp_ns: one.tension for one in clean}
    wrong = total = 0
    for one in outputs:
        good = one.status == 0
        assert one.stddev is not None
        stddev = np.maximum(one.stddev[: good.size], 1e-3)
        off = np.abs(one.tension - expected.get(one.stamp_ns, one.tension)) > 5.0 * stddev
        wrong, total = wrong + int((good & off).sum()), total + int(good.sum())
    assert wrong <= LAW * total
    assert named & set(names_of(robot, which))


FACTORS = {
    "negated": -1.0, "half": 0.5, "fifth less": 0.8, "quarter more": 1.25, "double": 2.0,
    "turns": 0.5 / np.pi, "still": 0.0,
}  # fmt: skip


@pytest.mark.parametrize("which", ["first joint", "first motor", "joints", "motors"])
@pytest.mark.parametrize("what", FACTORS)
def test_wrong_signs_and_factors_are_unsure_before_a_tension_is_wrong(what, which, robot, course):
    """About the angle at which the sensors were zeroed."""
    if abs(FACTORS[what] - 1.0) < 0.3 and load_share(robot).max() > 0.2:
        pytest.skip("a load in proportion to the pose is possible that does the same")
    first = course._replace(angle=course.angle - course.angle[0])
    names = {
        "first joint": [first_joint(robot)],
        "first motor": [robot.robot.motors[0].name],
    }.get(which) or names_of(robot, which)
    named = set()
    sent, wrong = messages_of(robot, first, 200), scaled(names, FACTORS[what])
    begin = course.angle[0].tolist()
    messages = [
        m._replace(positions=tuple(a + b for a, b in zip(m.positions, begin, strict=True)))
        for m in wrong(sent)
    ]
    outputs = feed(robot, messages, watch=lambda live, _: named.update(live.misfitting))
    assert judge(course, outputs).beyond(5.0) <= LAW
    assert named & set(names)


def test_axes_with_each_other_s_name_are_unsure(robot, course):
    motor, joint = robot.robot.motors[0].name, first_joint(robot)
    outputs = feed(robot, swapped(motor, joint)(messages_of(robot, course, 200)))
    assert judge(course, outputs).beyond(5.0) <= LAW


def test_readings_that_leave_the_range_leave_those_within_it_in_doubt(robot, course):
    joints = names_of(robot, "both")
    messages = in_degrees(joints)(messages_of(robot, course, 200))
    inside = messages_of(robot, course, 200)[-100:]
    outputs = feed(robot, [*messages[:-100], *inside])
    last = [one for one in outputs if one.stamp_ns >= inside[0].stamp_ns]
    assert all((one.status != 0).all() for one in last)
