"""Truth for validation: contact divided into cells, the winch found so that the joint balances.

The estimator lumps the friction of a pulley into one contact.  Here every pulley is a chain of
cells with their own bristles, so that adhesion and sliding arcs (Grashof) form by themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model import mechanism
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.errors import UsageError
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.plan import Model, prepare
from cdrj_ros.model.robot import Cable, Node, Profile, Pulley, Robot

Vector = NDArray[np.float64]

BALANCE_TOLERANCE: Final = 1e-6
"""Largest imbalance of the joint [N m]."""

BATCH: Final = 1000
"""Samples between two reports of progress."""

_NO_SPAN = (Profile(None, np.empty(0), np.zeros(1), np.empty(0)),)


@dataclass(frozen=True)
class Truth:
    """What really happened, on the rig's own time grid."""

    time: Vector
    """[s], shape (n,)."""
    motor_angle: Vector
    """Winch angle that balances the joint [rad], shape (n,)."""
    joint_angle: Vector
    """[rad], shape (n,)."""
    tension: NDArray[np.float64]
    """Of every element of the lumped robot [N], shape (n, elements)."""
    nodal_force: NDArray[np.float64]
    """Magnitude on every pulley [N], shape (n, pulleys)."""
    motor_effort: Vector
    """Of the cables on the motor [N m], shape (n,)."""
    joint_effort: Vector
    """Of the cables on the joint [N m], shape (n,)."""


def divide_contacts(robot: Robot, cells: int) -> Robot:
    """The same robot with every pulley cut into ``cells`` equal contact cells.

    Raises:
        UsageError: for cables described by positions.
    """
    return replace(robot, cables=tuple(_divide_cable(cable, cells) for cable in robot.cables))


def _divide_cable(cable: Cable, cells: int) -> Cable:
    if cable.routed:
        raise UsageError(
            f"cable {cable.name} is described by positions; contact cells need spans and wraps"
        )
    nodes: list[Node] = [cable.nodes[0]]
    spans = [cable.spans[0]]
    for pulley, span in zip(cable.pulleys, cable.spans[1:], strict=True):
        wrap = tuple(
            replace(profile, value=profile.value / cells, slope=profile.slope / cells)
            for profile in pulley.wrap
        )
        cell: Pulley = replace(pulley, wrap=wrap, cells=cells)
        nodes += [cell] * cells
        spans += [_NO_SPAN] * (cells - 1) + [span]
    nodes.append(cable.nodes[-1])
    return replace(cable, nodes=tuple(nodes), spans=tuple(spans))


def simulate(
    robot: Robot,
    time: Vector,
    joint_angle: Vector,
    joint_torque: Vector,
    motor_speed: float = 5.0,
    cells: int = 8,
    progress: Callable[[int], None] | None = None,
) -> Truth:
    """Move one joint as prescribed and turn its one motor so that the torques balance.

    Args:
        robot: one motor and one joint.
        time: increasing [s], shape (n,).
        joint_angle: prescribed [rad], shape (n,).
        joint_torque: what the cables must exert on the joint [N m], shape (n,).
        motor_speed: where the motor would have to turn faster than this [rad/s], the joint waits.
            At a reversal friction holds the joint's tensions while the motor takes up the
            difference along the cable: the joint dwells, as on the real machine.
        cells: contact cells a pulley.
        progress: called with the number of samples done.

    Raises:
        UsageError: more than one motor or joint, or a motion that no taut cable can balance.
    """
    if len(robot.motors) != 1 or len(robot.joints) != 1:
        raise UsageError("the simulated rig has one motor and one joint")
    fine = prepare(divide_contacts(robot, cells))
    lumped = prepare(robot)
    n = time.size
    estimates = np.empty((n, fine.layout.size))
    motor = np.empty(n)
    realised = np.empty(n)
    state = np.zeros(fine.state_size)
    dt = np.diff(time, prepend=time[0])
    torque = joint_torque * robot.joints[0].effort_sign
    angle, rising = _start(fine, joint_angle[0], torque[0])
    phase = 0
    for begin in range(0, n, BATCH):
        end = min(begin + BATCH, n)
        done, angle, phase = _balance(
            fine.plan, fine.numbers, state, angle, rising, phase, joint_angle, torque,
            dt[begin:end], motor_speed, fine.layout.joint_effort.start,
            motor[begin:end], realised[begin:end], estimates[begin:end],
        )  # fmt: skip
        if done < end - begin:
            raise UsageError(
                f"no winch angle balances {joint_torque[phase]:.4g} N m at "
                f"{robot.joints[0].name} = {joint_angle[phase]:.4g} rad, "
                f"t = {time[begin + done]:.4g} s: a cable would have to push"
            )
        if progress is not None:
            progress(end)
    return _read_out(lumped, fine, cells, time, motor, realised, estimates)


def _start(model: Model, joint_angle: float, torque: float) -> tuple[float, float]:
    """Winch angle that balances the frictionless start, and the sign of d(effort)/d(angle)."""
    reference = model.robot.motors[0].reference_angle
    out = np.empty(model.out_size)
    place = model.state_size + model.layout.joint_effort.start
    empty = np.zeros(model.state_size)
    angles = reference + np.linspace(-20.0, 20.0, 40001)
    efforts = np.empty(angles.size)
    for k, angle in enumerate(angles):
        advance(
            model.plan, model.numbers, empty, np.array([angle]), np.array([joint_angle]), 0.0, out
        )
        efforts[k] = out[place] - torque
    crossings = np.flatnonzero(efforts[:-1] * efforts[1:] <= 0.0)
    if crossings.size == 0:
        raise UsageError(f"no winch angle balances {torque:.4g} N m at the start")
    near = crossings[np.argmin(np.abs(angles[crossings] - reference))]
    return float(angles[near]), float(np.sign(efforts[near + 1] - efforts[near]))


@compiled
def _imbalance(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    motor_angle: float,
    joint_angle: float,
    torque: float,
    dt: float,
    effort_place: int,
    out: Vector,
) -> float:
    """Effort of the cables on the joint less the torque that it needs [N m]."""
    advance(plan, numbers, state, np.array([motor_angle]), np.array([joint_angle]), dt, out)
    return out[state.size + effort_place] - torque


@compiled
def _balance(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    angle: float,
    rising: float,
    phase: int,
    joint_angle: Vector,
    torque: Vector,
    dt: Vector,
    motor_speed: float,
    effort_place: int,
    motor: Vector,
    realised: Vector,
    estimates: NDArray[np.float64],
) -> tuple[int, float, int]:
    """Winch angle sample by sample: bracket, then regula falsi (Illinois).

    Friction makes the joint's effort a very flat function of the winch angle just after a
    reversal, so the bracket is widened geometrically.  Returns (samples done, angle, phase).
    """
    size = state.size
    wanted = estimates.shape[1]
    out = np.empty(size + wanted + mechanism.scratch_size(plan))
    for k in range(dt.size):
        following = min(phase + 1, torque.size - 1) if dt[k] > 0.0 else phase
        q, needed = joint_angle[following], torque[following]
        far = 2.0 * motor_speed * dt[k] + 1e-2
        a = angle
        fa = _imbalance(plan, numbers, state, a, q, needed, dt[k], effort_place, out)
        b, fb = a, fa
        width = 1e-5
        towards = -rising if fa > 0.0 else rising
        while abs(fb) > BALANCE_TOLERANCE and fa * fb > 0.0 and width < 2.0 * far:
            a, fa = b, fb
            b = angle + towards * width
            fb = _imbalance(plan, numbers, state, b, q, needed, dt[k], effort_place, out)
            width *= 2.0
        side = 0
        for _ in range(200):
            if abs(fb) <= BALANCE_TOLERANCE or fa * fb > 0.0:
                break
            c = b - fb * (b - a) / (fb - fa)
            fc = _imbalance(plan, numbers, state, c, q, needed, dt[k], effort_place, out)
            if fc * fb < 0.0:
                a, fa = b, fb
                side = 0
            else:
                side += 1
                fa *= 0.5 if side > 0 else 1.0
            b, fb = c, fc
        if abs(b - angle) > motor_speed * dt[k] and dt[k] > 0.0:
            following = phase  # the joint waits for the motor
            b = angle + (motor_speed * dt[k] if b > angle else -motor_speed * dt[k])
            before = _imbalance(
                plan, numbers, state, angle, joint_angle[phase], torque[phase], dt[k],
                effort_place, out,
            )  # fmt: skip
            after = _imbalance(
                plan, numbers, state, b, joint_angle[phase], torque[phase], dt[k],
                effort_place, out,
            )  # fmt: skip
            if abs(after - before) > 0.1 * (1.0 + abs(torque[phase])):
                return k, angle, phase
        elif abs(fb) > BALANCE_TOLERANCE:
            return k, angle, phase
        angle, phase = b, following
        motor[k], realised[k] = b, joint_angle[phase]
        state[:] = out[:size]
        estimates[k] = out[size : size + wanted]
    return dt.size, angle, phase


def _read_out(
    lumped: Model,
    fine: Model,
    cells: int,
    time: Vector,
    motor: Vector,
    joint: Vector,
    estimates: NDArray[np.float64],
) -> Truth:
    """Free spans and whole pulleys of the divided robot, in the lumped robot's order."""
    all_tensions = estimates[:, fine.layout.tension]
    columns, at = [], 0
    for cable in lumped.robot.cables:
        count = len(cable.nodes) - 1
        columns += [at + k * cells for k in range(count)]
        at += (count - 1) * cells + 1
    tension = all_tensions[:, columns]
    forces = []
    element = 0
    for cable in lumped.robot.cables:
        for pulley in cable.pulleys:
            wrap = sum(
                float(p.value[0]) if p.joint is None else np.interp(joint, p.angle, p.value)
                for p in pulley.wrap
            )
            before, after = tension[:, element], tension[:, element + 1]
            forces.append(
                np.sqrt(before**2 + after**2 - 2.0 * before * after * np.cos(wrap))  # (38)
            )
            element += 1
        element += 1
    return Truth(
        time,
        motor,
        joint,
        tension,
        np.stack(forces, axis=1),
        estimates[:, fine.layout.motor_effort][:, 0],
        estimates[:, fine.layout.joint_effort][:, 0],
    )
