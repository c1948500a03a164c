"""Measure what each controller achieves, on the true tensions and angles of the rig.

python tools/measure_controllers.py
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from closed_loop import FIRST_NS, STEP_NS, ClosedLoop

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from collision_stop import PushObserver
from friction_feedforward import FrictionFeedforward
from keep_taut import KeepTaut
from tension_limiter import TensionLimiter

from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.load import make_load

DT = 1e-3  # [s]


class Effect(NamedTuple):
    """Result of one controller beside that without it."""

    name: str
    measure: str
    """What the values are, with the unit."""
    without: float
    having: float
    least: float = np.nan
    """Smallest true tension with it [N]."""


def limiter(seconds=5.0, limit=60.0):
    """A wished speed of 1 rad/s drives the prototype's joint against an end stop at 0.2 rad."""

    def peak(limited):
        loop = ClosedLoop("prototype", upper=0.2, max_torque=20.0)
        law = TensionLimiter(loop.model, limit, creep_speed=0.3)
        largest = 0.0
        for k in range(round(seconds / DT)):
            wished = np.array([1.0 if 0.2 < k * DT < 0.8 * seconds else 0.0])
            speed = law.allowed(wished, *loop.tensions()[1:])[0] if limited else wished
            loop.command("velocity", speed)
            loop.step()
            largest = max(largest, loop.rig.tension.max())
        return largest

    return Effect("tension_limiter", "largest true tension [N]", peak(False), peak(True))


def smooth_target(time_s, amplitude=0.4, frequency_hz=0.4):
    """A sine that starts from rest: angle [rad], speed [rad/s] and acceleration [rad/s^2]."""
    grown = amplitude * (1.0 - np.exp(-((time_s / 0.5) ** 3)))
    angle = grown * np.sin(2.0 * np.pi * frequency_hz * time_s)
    speed = np.gradient(angle, DT)
    return angle, speed, np.gradient(speed, DT)


def feedforward(seconds=6.0):
    """The prototype's joint follows a sine of 23 degrees with a payload of 0.3 kg."""
    time_s = np.arange(round(seconds / DT) + 1) * DT
    target, speed, acceleration = smooth_target(time_s)

    def error(compensated):
        loop = ClosedLoop("prototype")
        law = FrictionFeedforward(loop.model, loop.rig.load)
        found = [0.0]
        for k in range(1, time_s.size):
            motion = target[k], speed[k], acceleration[k]
            stamp_ns = FIRST_NS + k * STEP_NS
            angle = law.angle(stamp_ns, *motion) if compensated else law.rigid(target[k])
            loop.command("position", [angle])
            loop.step()
            found.append(np.degrees(loop.rig.joint_angle[0] - target[k]))
        return np.sqrt(np.mean(np.square(found[500:])))

    return Effect("friction_feedforward", "tracking error, rms [deg]", error(False), error(True))


def brief_load(loop, time_s):
    """A payload of 20 g that grows to 350 g for a second of every six, first after 2.5 s."""
    phase = (time_s - 2.5) % 6.0
    share = min(max(min(phase, 1.0 - phase) / 0.2, 0.0), 1.0)
    loop.rig.set_load(make_load("pendulum", 0.02 + 0.33 * share, 0.02))


def taut(seconds=12.0, floor=2.0, share=-0.5):
    """The finger's first joint follows a sine while the payload changes.

    Without the controller, the co-contraction is constant: the least one, from ``share`` on in
    steps of 10 % of the robot file's preloads, whose smallest true tension is not below that with
    the controller.
    Both are compared from 2 s on.
    """
    time_s = np.arange(round(seconds / DT) + 1) * DT
    pose = np.zeros((time_s.size, 2))
    pose[:, 0] = 0.5 * np.minimum(time_s, 1.0) + smooth_target(time_s, 0.35, 0.3)[0]

    def tensions(share):
        loop = ClosedLoop("finger", payload=0.02, damping=0.02, cells=4, exact=True)
        law = KeepTaut(loop.model, floor)
        motors = follow_joints(loop.model, pose).motor_angle
        found = []
        for k in range(1, time_s.size):
            brief_load(loop, k * DT)
            if share is None:
                added = law.update(DT, *loop.tensions()[1:])
            else:
                added = law.turn * share
            loop.command("position", motors[k] + added)
            loop.step()
            found.append(loop.rig.tension)
        return np.array(found)[2000:]

    adaptive = tensions(None)
    while (constant := tensions(share)).min() < adaptive.min():
        share += 0.1
    return Effect("keep_taut", "mean true tension [N]", constant.mean(), adaptive.mean(),
                  adaptive.min())  # fmt: skip


def push(seconds=8.0, torque=1.0, threshold=0.5, pushed_s=5.2):
    """A motor swings the prototype's joint; something pushes on it for half a second.

    ``without`` is the largest estimate of the external torque before the push, ``having`` the time
    from the push to its detection.
    """
    loop = ClosedLoop("prototype")
    observer = PushObserver(loop.rig.load)
    begin = round(pushed_s / DT)
    torques, detected, last_ns = [], np.inf, None
    for k in range(1, round(seconds / DT)):
        if k == begin:
            loop.rig.push(torque, 0.5)
        swing = 1.5 * np.cos(2.0 * np.pi * 0.4 * k * DT) * min(k * DT / 0.5, 1.0)
        loop.command("velocity", [swing])
        loop.step()
        one = loop.estimate
        if one is not None and one.stamp_ns != last_ns:
            dt = (one.stamp_ns - last_ns) * 1e-9 if last_ns else DT
            last_ns = one.stamp_ns
            angle = loop.estimator.sample.joint_angle[0]
            found = observer.update(dt, angle, float(one.joint_effort[0]))
            if abs(found) > threshold + 2.0 * one.stddev[-1] and k > 1000:
                detected = min(detected, (k - begin) * DT)
        torques.append(observer.torque)
    quiet = np.abs(torques[1000 : begin - 1])
    measure = "largest torque before the push [N m] | time to detection [s]"
    return Effect("collision_stop", measure, quiet.max(), detected)


def main():
    """Measure and print."""
    for measured in (limiter, feedforward, taut, push):
        name, measure, without, having, _ = measured()
        print(f"{name}: {measure}: {without:.4g} | {having:.4g}", flush=True)


if __name__ == "__main__":
    main()
