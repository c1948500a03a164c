"""Compiled solution of joints without encoder from the efforts of the motors.

Called by ``cdrj_ros.estimation.motor_alone``, which describes the method; see docs/motor_alone.md.
"""

from __future__ import annotations

from math import isfinite, nan, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import lean, stage
from cdrj_ros.model.friction_history import impose_friction
from cdrj_ros.model.mechanism import advance_robot
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.state import (
    EstimateViews,
    ScratchViews,
    estimate_size,
    estimate_views,
    scratch_views,
    state_views,
)
from cdrj_ros.model.status import INVALID
from cdrj_ros.model.views import copy_part, part, table

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

# Indices in ``Alone.progress``.
TURN, LAST_STAMP, PROGRESS = range(3)

# Indices in ``Unmeasured.agenda``: the phase of a solution, whether it needs derivatives and how
# many evaluations it has for them, Gauss-Newton steps so far, joint, place and round of a search,
# whether a search has just ended, whether all evaluations were solved.
PHASE, SLOPES, SHIFT, STEPS, JOINT, PLACE, ROUND, SEARCHED, SOLVED, AGENDA = range(10)

# Phases, each of which ends with an evaluation.
DONE, FOLLOW, PREDICT, CORRECT, FINAL, SEARCH = range(6)

ITERATIONS: Final = 6
"""Most Gauss-Newton steps of a prediction or a correction."""

TOLERANCE: Final = 0.01
"""A Gauss-Newton step below this fraction of the difference step ends the iteration."""

LARGEST_STEP: Final = 150.0
"""Largest Gauss-Newton step, as a multiple of the difference step."""

PLACES: Final = 301
"""Angles of each joint that are tried where the angle is unknown."""

ROUNDS: Final = 3
"""Rounds of a search over several joints."""

CORRELATED: Final = 0.05
"""Time over which the error of an effort persists [s]; errors further apart are independent."""

LOST: Final = 5.0
"""A difference between measured and estimated effort above this multiple of the effort's standard
deviation means that the joint is lost,"""

LOST_FOR: Final = 0.05
"""if it lasts this long [s]; its angle is then searched over the whole range."""

APART_NS: Final = 1_500_000
"""One member is updated at most this often [ns]."""


class Unmeasured(NamedTuple):
    """The joints without encoder, u of them, what is known of them, and scratch."""

    joints: NDArray[np.int64]
    """Their indices, shape (u,)."""
    measured: NDArray[np.int64]
    """Indices of the other joints."""
    lower: Vector
    """Ends of their ranges [rad] or [m], shape (u,)."""
    upper: Vector
    start: Vector
    """Angles from which the first search begins, shape (u,)."""
    step: Vector
    """Difference by which derivatives are taken, shape (u,)."""
    wander: Vector
    """Variance per second of a joint's departure from the motion of its cables, shape (u,)."""
    load_drift: Vector
    """Variance per second of the load; 0 where nothing is known of it, shape (u,)."""
    noise: Vector
    """Standard deviation of measured efforts [N m], shape (motors,)."""
    angle: Vector
    """Scratch: angles of all joints, shape (joints,)."""
    effort: Vector
    """Scratch: efforts of the motors, shape (motors,), and their derivatives."""
    by_effort: Table
    load: Vector
    """Scratch: efforts of the joints without encoder, shape (u,), and their derivatives."""
    by_load: Table
    target: Vector
    """Scratch: predicted angles, shape (u,)."""
    right: Vector
    matrix: Table
    inverse: Table
    information: Table
    """Scratch, shape (u, u)."""
    best: Vector
    """Scratch of a search: angle before it, best angle and its misfit, shape (3,)."""
    agenda: NDArray[np.int64]
    """What a solution does next, shape (AGENDA,)."""
    out: Vector
    """Scratch of ``advance``."""


class Alone(NamedTuple):
    """All memory of the estimate (row 0) and of the members of its ensemble (the other rows)."""

    numbers: Table
    """Of the prepared robots, shape (rows, numbers); read-only."""
    states: Table
    """Shape (rows, state_size)."""
    memories: Table
    """See ``Memory``, shape (rows, 2 + 2 u + u^2)."""
    stamps: NDArray[np.int64]
    """Of the last updates [ns], shape (rows,)."""
    shares: Table
    """Initial friction as a share of its bound, shape (rows, pulleys)."""
    effort_errors: Table
    """Lasting errors of the efforts [N m], shape (rows, motors)."""
    reading_errors: Table
    """Rows of reading errors of motors and measured joints, used in turn [rad]."""
    progress: NDArray[np.int64]
    """Updates of members so far, and the last stamp [ns]."""
    columns: NDArray[np.int64]
    """Places in the estimate of the quantities that have a standard deviation."""
    deviation: Table
    """Differences of the members from the estimate: of those quantities, then of the angles."""
    variance: Vector
    unmodelled: Table
    """See ``cdrj_ros.estimation.discrepancy``, shape (2, columns); row 0 is zero, because the
    members' lasting errors of the efforts contain the model's error."""
    motor_angle: Vector
    """Scratch, shape (motors,)."""
    measured_angle: Vector
    """Scratch, shape (measured joints,)."""
    motor_effort: Vector
    """Scratch, shape (motors,)."""
    shifted: Vector
    """Scratch: the angle that is shifted, shape (1,)."""
    joints: Unmeasured


class Memory(NamedTuple):
    """What a solution remembers beside the robot's state: views of one row."""

    started: Vector
    """0 before the first sample, then 1, shape (1,)."""
    lost: Vector
    """Time since which the effort has not been explained [s], shape (1,)."""
    angle: Vector
    """Shape (u,)."""
    load: Vector
    """Shape (u,)."""
    covariance: Table
    """Of the angles, shape (u, u)."""


class Reading(NamedTuple):
    """Readings of one sample."""

    motor_angle: Vector
    measured_angle: Vector
    """Of the joints that have an encoder."""
    effort: Vector
    """NaN where none was heard [N m], shape (motors,)."""
    dt: float
    """Time since the last update [s]."""


class Recorded(NamedTuple):
    """Samples, and where their results are written."""

    stamp_ns: NDArray[np.int64]
    motor_angle: Table
    measured_angle: Table
    effort: Table
    """NaN where none was heard [N m], shape (n, motors)."""
    estimates: Table
    """Shape (n, estimate_size)."""
    stddevs: Table
    """Shape (n, columns)."""
    angles: Table
    """Of the joints without encoder, shape (n, u)."""
    angle_stddevs: Table
    """Shape (n, u)."""


@stage
def _memory(row: Vector, count: int) -> Memory:
    """Views of a row of ``Alone.memories``."""
    return Memory(
        part(row, 0, 1),
        part(row, 1, 2),
        part(row, 2, 2 + count),
        part(row, 2 + count, 2 + 2 * count),
        table(row, 2 + 2 * count, count, count),
    )


@stage
def _estimate(plan: NDArray[np.int64], state_size: int, out: Vector) -> EstimateViews:
    """The estimate that ``advance`` has written."""
    sizes = plan_views(plan).sizes
    return estimate_views(sizes, part(out, state_size, state_size + estimate_size(sizes)))


@stage
def _scratch(plan: NDArray[np.int64], state_size: int, out: Vector) -> ScratchViews:
    """The scratch that ``advance`` has written."""
    sizes = plan_views(plan).sizes
    return scratch_views(sizes, part(out, state_size + estimate_size(sizes), out.size))


@lean
def _shift(joints: Unmeasured) -> None:
    """Shift the angle by which the next derivative is taken."""
    a = joints.agenda[SHIFT]
    if joints.agenda[SLOPES] != 0 and a < joints.joints.size:
        joints.angle[joints.joints[a]] += joints.step[a]


@lean
def _collect(
    plan: NDArray[np.int64], state: Vector, joints: Unmeasured, before: Vector, solved: bool
) -> bool:
    """Take the efforts and loads of an evaluation; whether the phase needs another one.

    For derivatives every angle is shifted in turn; the last evaluation is at the angles themselves.
    ``before`` holds the angle that was shifted.
    """
    agenda, count, a = joints.agenda, joints.joints.size, joints.agenda[SHIFT]
    if a == 0:
        agenda[SOLVED] = 1
    if not solved:
        agenda[SOLVED] = 0
    estimate = _estimate(plan, state.size, joints.out)
    copy_part(estimate.motor_effort, 0, joints.effort)
    for b in range(count):
        joints.load[b] = estimate.joint_effort[joints.joints[b]]
    if agenda[SLOPES] == 0:
        return False
    if a == count:
        agenda[SHIFT] = 0
        _divide(joints)
        return False
    joints.angle[joints.joints[a]] = before[0]
    for m in range(joints.effort.size):
        joints.by_effort[m, a] = joints.effort[m]
    for b in range(count):
        joints.by_load[b, a] = joints.load[b]
    agenda[SHIFT] = a + 1
    return True


@lean
def _divide(joints: Unmeasured) -> None:
    """Turn shifted efforts and loads into derivatives."""
    for a in range(joints.joints.size):
        for m in range(joints.effort.size):
            joints.by_effort[m, a] = (joints.by_effort[m, a] - joints.effort[m]) / joints.step[a]
        for b in range(joints.joints.size):
            joints.by_load[b, a] = (joints.by_load[b, a] - joints.load[b]) / joints.step[a]


@lean
def _invert(matrix: Table, inverse: Table) -> None:
    """Invert a symmetric positive definite matrix by Cholesky's method; ``matrix`` is destroyed."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[i, i] = sqrt(max(total, 1e-300))
            else:
                matrix[i, j] = total / matrix[j, j]
    for c in range(n):
        for i in range(n):
            total = 1.0 if i == c else 0.0
            for k in range(i):
                total -= matrix[i, k] * inverse[k, c]
            inverse[i, c] = total / matrix[i, i]
        for i in range(n - 1, -1, -1):
            total = inverse[i, c]
            for k in range(i + 1, n):
                total -= matrix[k, i] * inverse[k, c]
            inverse[i, c] = total / matrix[i, i]


@lean
def _move(joints: Unmeasured) -> bool:
    """Move the angles by ``inverse`` times ``right``, within limits; True if they have arrived."""
    arrived = True
    for a in range(joints.joints.size):
        change = 0.0
        for b in range(joints.joints.size):
            change += joints.inverse[a, b] * joints.right[b]
        most = LARGEST_STEP * joints.step[a]
        change = min(max(change, -most), most)
        j = joints.joints[a]
        new = min(max(joints.angle[j] + change, joints.lower[a]), joints.upper[a])
        arrived &= abs(new - joints.angle[j]) <= TOLERANCE * joints.step[a]
        joints.angle[j] = new
    return arrived


@lean
def _taken(plan: NDArray[np.int64], numbers: Vector, state: Vector, read: Reading, c: int) -> float:
    """Cable that the drums of cable ``c`` have taken up since the state [m]."""
    parts = plan_views(plan)
    constants, before = number_views(parts.sizes, numbers), state_views(parts.sizes, state)
    taken = 0.0
    for end in range(2 * c, 2 * c + 2):
        motor, drum = parts.ends[end].motor, constants.ends[end]
        if motor >= 0:
            turned = read.motor_angle[motor] - before.angle[motor]
            taken += drum.radius * drum.winding * turned
    return taken


@lean
def _arms(
    plan: NDArray[np.int64], state: Vector, joints: Unmeasured, c: int, arms: Vector
) -> float:
    """Write by how much cable ``c`` gets longer per unit of each angle without encoder.

    Returns:
        By how much the measured joints have made it longer since the state [m].
    """
    parts = plan_views(plan)
    cable, before = parts.cables[c], state_views(parts.sizes, state)
    by_joint = _scratch(plan, state.size, joints.out).length_by_joint
    longer = 0.0
    arms[:] = 0.0
    for e in range(cable.first_element, cable.first_element + cable.elements):
        for a in range(arms.size):
            arms[a] += by_joint[e, joints.joints[a]]
        for k in range(joints.measured.size):
            j = joints.measured[k]
            longer += by_joint[e, j] * (joints.angle[j] - before.angle[parts.sizes.motors + j])
    return longer


@lean
def _follow(
    plan: NDArray[np.int64], numbers: Vector, state: Vector, read: Reading, joints: Unmeasured
) -> None:
    """Move the angles as the cables would turn the joints if their elongation stayed the same.

    The change is the least-squares solution over all cables; winches and measured joints have
    moved since the state.  ``joints.out`` is that of the angles before.
    """
    joints.matrix[:] = 0.0
    joints.right[:] = 0.0
    for c in range(len(plan_views(plan).cables)):
        longer = _arms(plan, state, joints, c, joints.target)
        longer += _taken(plan, numbers, state, read, c)
        _weigh(joints, joints.target, -longer, 1.0)
    most = 0.0
    for a in range(joints.joints.size):
        most = max(most, joints.matrix[a, a])
    if not most > 0.0:
        return
    for a in range(joints.joints.size):
        joints.matrix[a, a] += 1e-9 * most
    _invert(joints.matrix, joints.inverse)
    _move(joints)


@lean
def _weigh_prediction(joints: Unmeasured, load: Vector, dt: float) -> None:
    """Normal equations of a prediction, (M1): near ``target``, and with loads near ``load``."""
    for a in range(joints.joints.size):
        weight = 1.0 / (joints.wander[a] * dt)
        joints.right[a] = weight * (joints.target[a] - joints.angle[joints.joints[a]])
        for b in range(joints.joints.size):
            joints.matrix[a, b] = weight if a == b else 0.0
    for k in range(joints.joints.size):
        if joints.load_drift[k] > 0.0:
            weight = 1.0 / (joints.load_drift[k] * dt)
            _weigh(joints, joints.by_load[k], load[k] - joints.load[k], weight)
    _invert(joints.matrix, joints.inverse)


@lean
def _aim(joints: Unmeasured) -> None:
    """Make the present angles the predicted ones."""
    for a in range(joints.joints.size):
        joints.target[a] = joints.angle[joints.joints[a]]


@lean
def _knows_loads(joints: Unmeasured) -> bool:
    """Whether anything is known of a load."""
    known = False
    for a in range(joints.joints.size):
        known |= joints.load_drift[a] > 0.0
    return known


@lean
def _end_prediction(memory: Memory, joints: Unmeasured, dt: float, known: bool) -> None:
    """Take the present angles as predicted, widen their covariance, and prepare the correction.

    ``known`` says whether ``joints.inverse`` is the covariance of the change, or else the joint has
    wandered freely.
    """
    _aim(joints)
    for a in range(joints.joints.size):
        for b in range(joints.joints.size):
            own = joints.wander[a] * dt if a == b else 0.0
            memory.covariance[a, b] += joints.inverse[a, b] if known else own
    _limit(memory.covariance, joints)
    _begin_correction(memory, joints)


@lean
def _begin_correction(memory: Memory, joints: Unmeasured) -> None:
    """The next phase corrects the angles around ``joints.target``."""
    for a in range(joints.joints.size):
        for b in range(joints.joints.size):
            joints.matrix[a, b] = memory.covariance[a, b]
    _invert(joints.matrix, joints.information)
    _next(joints, CORRECT, True)
    joints.agenda[STEPS] = 0


@stage
def _next(joints: Unmeasured, phase: int, slopes: bool) -> None:
    """The next phase, and whether it needs derivatives."""
    joints.agenda[PHASE] = phase
    joints.agenda[SLOPES] = 1 if slopes else 0
    joints.agenda[SHIFT] = 0


@stage
def _weigh(joints: Unmeasured, slope: Vector, difference: float, weight: float) -> None:
    """Add an equation, slope times change = difference, to the normal equations."""
    for a in range(slope.size):
        joints.right[a] += weight * slope[a] * difference
        for b in range(slope.size):
            joints.matrix[a, b] += weight * slope[a] * slope[b]


@lean
def _limit(covariance: Table, joints: Unmeasured) -> None:
    """Keep standard deviations within those of an angle that is only known to be in its range."""
    for a in range(joints.joints.size):
        most = (joints.upper[a] - joints.lower[a]) ** 2 / 12.0
        if covariance[a, a] > most:
            share = sqrt(most / covariance[a, a])
            for b in range(joints.joints.size):
                covariance[a, b] *= share
                covariance[b, a] *= share


@lean
def _weigh_correction(joints: Unmeasured, read: Reading) -> None:
    """Normal equations of a correction, (M2): near ``target``, and with the measured efforts.

    At the start ``read.dt`` is 0, and the efforts count as independent of earlier ones.
    """
    independent = min(read.dt / CORRELATED, 1.0) if read.dt > 0.0 else 1.0
    for a in range(joints.joints.size):
        joints.right[a] = 0.0
        for b in range(joints.joints.size):
            away = joints.target[b] - joints.angle[joints.joints[b]]
            joints.right[a] += joints.information[a, b] * away
            joints.matrix[a, b] = joints.information[a, b]
    for m in range(read.effort.size):
        if isfinite(read.effort[m]):
            weight = independent / joints.noise[m] ** 2
            _weigh(joints, joints.by_effort[m], read.effort[m] - joints.effort[m], weight)
    _invert(joints.matrix, joints.inverse)


@lean
def _misfit(read: Reading, joints: Unmeasured) -> float:
    """Sum of the squared differences of measured and estimated efforts, in standard deviations."""
    total = 0.0
    for m in range(read.effort.size):
        if isfinite(read.effort[m]):
            total += ((read.effort[m] - joints.effort[m]) / joints.noise[m]) ** 2
    return total


@lean
def _begin_search(joints: Unmeasured) -> None:
    """The next phase searches the angles over their ranges."""
    joints.agenda[JOINT] = joints.agenda[PLACE] = joints.agenda[ROUND] = 0
    joints.best[0] = joints.best[1] = joints.angle[joints.joints[0]]
    joints.best[2] = 1e300
    joints.angle[joints.joints[0]] = joints.lower[0]
    _next(joints, SEARCH, False)


@lean
def _search(read: Reading, memory: Memory, joints: Unmeasured) -> None:
    """One place of a search: one joint after the other, several times if there are several.

    Among angles that explain the efforts equally well, the nearest to the one before is taken.
    The angles found are then corrected.
    """
    agenda, best = joints.agenda, joints.best
    a = agenda[JOINT]
    j, span = joints.joints[a], joints.upper[a] - joints.lower[a]
    away = (joints.angle[j] - best[0]) / span
    misfit = _misfit(read, joints) + 1e-3 * away * away
    if agenda[SOLVED] != 0 and misfit < best[2]:
        best[1], best[2] = joints.angle[j], misfit
    agenda[PLACE] += 1
    if agenda[PLACE] < PLACES:
        joints.angle[j] = joints.lower[a] + span * (agenda[PLACE] / (PLACES - 1.0))
        return
    joints.angle[j] = best[1]
    agenda[PLACE] = 0
    agenda[JOINT] = (a + 1) % joints.joints.size
    if agenda[JOINT] == 0:
        agenda[ROUND] += 1
    if agenda[ROUND] < (1 if joints.joints.size == 1 else ROUNDS):
        j = joints.joints[agenda[JOINT]]
        best[0] = best[1] = joints.angle[j]
        best[2] = 1e300
        joints.angle[j] = joints.lower[agenda[JOINT]]
        return
    _end_search(memory, joints)


@lean
def _end_search(memory: Memory, joints: Unmeasured) -> None:
    """Nothing is known of the angles but their ranges and what the search has found."""
    _aim(joints)
    for a in range(joints.joints.size):
        for b in range(joints.joints.size):
            span = joints.upper[a] - joints.lower[a]
            memory.covariance[a, b] = span * span / 12.0 if a == b else 0.0
    joints.agenda[SEARCHED] = 1
    _begin_correction(memory, joints)


@lean
def _begin(state: Vector, read: Reading, memory: Memory, joints: Unmeasured) -> None:
    """Prepare the solution of one sample."""
    joints.agenda[:] = 0
    for k in range(joints.measured.size):
        joints.angle[joints.measured[k]] = read.measured_angle[k]
    started = memory.started[0] != 0.0
    for a in range(joints.joints.size):
        joints.angle[joints.joints[a]] = memory.angle[a] if started else joints.start[a]
    if not started:
        state[:] = 0.0
        _begin_search(joints)
    else:
        _next(joints, FOLLOW if read.dt > 0.0 else FINAL, False)


@lean
def _correct(memory: Memory, read: Reading, joints: Unmeasured) -> None:
    """A Gauss-Newton step of the correction by the efforts."""
    arrived = True
    if joints.agenda[SOLVED] != 0:
        _weigh_correction(joints, read)
        arrived = _move(joints)
        for a in range(joints.joints.size):
            for b in range(joints.joints.size):
                memory.covariance[a, b] = joints.inverse[a, b]
    joints.agenda[STEPS] += 1
    if arrived or joints.agenda[STEPS] == ITERATIONS:
        _next(joints, FINAL, False)


@lean
def _predict(memory: Memory, read: Reading, joints: Unmeasured) -> None:
    """A Gauss-Newton step of the prediction by the loads."""
    known = joints.agenda[SOLVED] != 0
    arrived = True
    if known:
        _weigh_prediction(joints, memory.load, read.dt)
        arrived = _move(joints)
    joints.agenda[STEPS] += 1
    if arrived or joints.agenda[STEPS] == ITERATIONS:
        _end_prediction(memory, joints, read.dt, known)


@lean
def _end(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    share: Vector,
    read: Reading,
    memory: Memory,
    joints: Unmeasured,
) -> None:
    """Accept a solution, or search: for the angle of a lost joint, or again with friction."""
    searched, sizes = joints.agenda[SEARCHED] != 0, plan_views(plan).sizes
    if memory.started[0] == 0.0 and state_views(sizes, state).started[0] == 0.0:
        if state_views(sizes, joints.out).started[0] == 0.0:  # no such pose
            joints.agenda[PHASE] = DONE
            return
        copy_part(joints.out, 0, state)
        begin = state.size + estimate_size(sizes)
        impose_friction(plan, numbers, share, state, part(joints.out, begin, joints.out.size))
        _begin_search(joints)
        return
    unexplained = _misfit(read, joints) > LOST * LOST * read.effort.size
    memory.lost[0] = memory.lost[0] + read.dt if unexplained and not searched else 0.0
    if memory.lost[0] > LOST_FOR:
        memory.lost[0] = 0.0
        _begin_search(joints)
        return
    memory.started[0] = 1.0
    copy_part(joints.out, 0, state)
    for a in range(joints.joints.size):
        memory.angle[a] = joints.angle[joints.joints[a]]
        memory.load[a] = joints.load[a]
    joints.agenda[PHASE] = DONE


@lean
def _proceed(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    share: Vector,
    read: Reading,
    memory: Memory,
    joints: Unmeasured,
) -> None:
    """Do what follows from the evaluations of a phase, and choose the next one."""
    phase = joints.agenda[PHASE]
    if phase == FOLLOW:
        _follow(plan, numbers, state, read, joints)
        _aim(joints)
        if _knows_loads(joints):
            _next(joints, PREDICT, True)
            joints.agenda[STEPS] = 0
        else:
            _end_prediction(memory, joints, read.dt, False)
    elif phase == PREDICT:
        _predict(memory, read, joints)
    elif phase == CORRECT:
        _correct(memory, read, joints)
    elif phase == SEARCH:
        _search(read, memory, joints)
    else:
        _end(plan, numbers, state, share, read, memory, joints)


@lean
def _read_row(alone: Alone, row: int, recorded: Recorded, k: int) -> None:
    """Write the readings of sample ``k`` with the errors of one row."""
    errors = alone.reading_errors[alone.progress[TURN] % len(alone.reading_errors)]
    motors = alone.motor_angle.size
    for m in range(motors):
        error = errors[m] if row > 0 else 0.0
        alone.motor_angle[m] = recorded.motor_angle[k, m] + error
        alone.motor_effort[m] = recorded.effort[k, m] + alone.effort_errors[row, m]
    for a in range(alone.measured_angle.size):
        error = errors[motors + a] if row > 0 else 0.0
        alone.measured_angle[a] = recorded.measured_angle[k, a] + error


@lean
def _solve_row(
    plan: NDArray[np.int64], alone: Alone, row: int, stamp: int, recorded: Recorded, k: int
) -> None:
    """Solve sample ``k`` with the numbers, the history and the errors of one row."""
    _read_row(alone, row, recorded, k)
    joints, state, numbers = alone.joints, alone.states[row], alone.numbers[row]
    memory = _memory(alone.memories[row], joints.joints.size)
    dt = (stamp - alone.stamps[row]) * 1e-9 if memory.started[0] != 0.0 else 0.0
    read = Reading(alone.motor_angle, alone.measured_angle, alone.motor_effort, dt)
    _begin(state, read, memory, joints)
    while joints.agenda[PHASE] != DONE:
        j = joints.joints[joints.agenda[SHIFT] % joints.joints.size]
        alone.shifted[0] = joints.angle[j]
        _shift(joints)
        solved = advance_robot(plan, numbers, state, read.motor_angle, joints.angle, dt, joints.out)
        if not _collect(plan, state, joints, alone.shifted, solved):
            _proceed(plan, numbers, state, alone.shares[row], read, memory, joints)
    alone.stamps[row] = stamp


@lean
def _take_deviation(alone: Alone, row: int, estimate: Vector, angle: Vector) -> None:
    """Store a member's difference from the estimate and its part of the variance."""
    columns, count = alone.columns.size, alone.deviation.shape[0]
    own = alone.states.shape[1]
    for c in range(columns + angle.size):
        if c < columns:
            d = alone.joints.out[own + alone.columns[c]] - estimate[alone.columns[c]]
        else:
            d = alone.memories[row, 2 + c - columns] - angle[c - columns]
        if not isfinite(d):
            continue
        before = alone.deviation[row - 1, c]
        alone.variance[c] += (d * d - before * before) / count
        alone.deviation[row - 1, c] = d


@lean
def _write_stddev(alone: Alone, estimate: Vector, stddev: Vector, angle_stddev: Vector) -> None:
    """Standard deviations of the quantities, with (U5) and (U6), and of the angles."""
    columns = alone.columns.size
    for c in range(columns):
        total = max(alone.variance[c], 0.0) + alone.unmodelled[0, c]
        slack = alone.unmodelled[1, c]
        if abs(estimate[alone.columns[c]]) <= slack:
            total = max(total, slack * slack)
        stddev[c] = sqrt(total)
    own = _memory(alone.memories[0], angle_stddev.size)
    for a in range(angle_stddev.size):
        total = max(alone.variance[columns + a], 0.0) + own.covariance[a, a]
        angle_stddev[a] = sqrt(total)


@lean
def forget(alone: Alone) -> None:
    """Discard everything that was heard; the next effort starts anew."""
    alone.memories[:] = 0.0
    alone.states[:] = 0.0
    alone.deviation[:] = 0.0
    alone.variance[:] = 0.0
    alone.progress[TURN] = 0


@lean
def _write_unknown(plan: NDArray[np.int64], recorded: Recorded, k: int) -> None:
    """No effort was heard: no numbers, and every element is ``INVALID``."""
    recorded.estimates[k, :] = nan
    estimate_views(plan_views(plan).sizes, recorded.estimates[k]).status[:] = INVALID
    recorded.stddevs[k, :] = nan
    recorded.angles[k, :] = nan
    recorded.angle_stddevs[k, :] = nan


@lean
def run_alone(plan: NDArray[np.int64], alone: Alone, recorded: Recorded) -> None:
    """Solve samples one after the other; one or many at a time give the same bits.

    At the first sample all members are solved, later one in turn, at most every ``APART_NS``.

    Args:
        plan: of the prepared robot.
        alone: the estimate and its ensemble, changed.
        recorded: the samples; their results are written.
    """
    members, progress = alone.deviation.shape[0], alone.progress
    for k in range(recorded.stamp_ns.size):
        stamp = recorded.stamp_ns[k]
        heard = False
        for m in range(alone.motor_effort.size):
            heard |= isfinite(recorded.effort[k, m])
        if not heard:
            forget(alone)
            _write_unknown(plan, recorded, k)
            continue
        first = alone.memories[0, 0] == 0.0
        _solve_row(plan, alone, 0, stamp, recorded, k)
        estimate, angle = recorded.estimates[k], recorded.angles[k]
        copy_part(alone.joints.out, alone.states.shape[1], estimate)
        for a in range(angle.size):
            angle[a] = alone.memories[0, 2 + a]
        count = 0
        if members > 0:
            due = stamp - progress[LAST_STAMP] >= APART_NS
            count = members if first else (1 if due else 0)
        for _ in range(count):
            row = 1 + progress[TURN] % members
            _solve_row(plan, alone, row, stamp, recorded, k)
            _take_deviation(alone, row, estimate, angle)
            progress[TURN] += 1
            progress[LAST_STAMP] = stamp
        _write_stddev(alone, estimate, recorded.stddevs[k], recorded.angle_stddevs[k])
