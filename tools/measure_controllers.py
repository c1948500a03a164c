"""Measure what each controller achieves, on the true tensions and angles of the rig.

python tools/measure_controllers.py
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from collision_stop import PushObserver
from friction_feedforward import FrictionFeedforward
from keep_taut import KeepTaut
from tension_limiter import TensionLimiter

from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.drives import Drives, checked_command, drive_limits, follow_joints
from cdrj_ros.simulation.live import LiveRig, LiveSettings
from cdrj_ros.simulation.load import make_load, usual_load
from cdrj_ros.simulation.motion import differences
from cdrj_ros.simulation.sensors import SensorSettings, encoder_groups, truth_table

DT = 1e-3  # [s]
STEP_NS = 1_000_000
FRESH_S = 1e-4  # the angles are as old as their stamps say, to this [s]
FIRST_NS = 1_000_000_000  # a stamp of 0 denotes a missing stamp


class ClosedLoop:
    """Rig, estimator and a controller without ROS: every run gives the same numbers."""

    def __init__(self, robot, payload=0.3, damping=0.05, cells=8, exact=False, **limits):
        """Put the rig at rest.

        Args:
            robot: robot file, or the name of an installed one.
            payload: mass that the first joint carries [kg].
            damping: of the first joint [N m s/rad].
            cells: number of contact cells per pulley.
            exact: whether the numbers of the robot file are exact, as if identified.
            limits: of the motors (``drive_limits``) and ``upper`` end stop [rad].
        """
        self.model = load_model(robot)
        if exact:
            kinds = (("motors", self.model.layout.motors), ("joints", self.model.layout.joints))
            clocks = [f"{kind}.{name}.clock_offset" for kind, names in kinds for name in names]
            known = {"others": "exact", "parameters": clocks, "stddev": [FRESH_S] * len(clocks)}
            document = {**self.model.robot.document, "uncertainty": known}
            self.model = prepare(build_robot(document, self.model.robot.source))
        robot = self.model.robot
        stops = {"upper": limits.pop("upper")} if "upper" in limits else {}
        load = make_load(usual_load(robot, 0), payload, damping)
        self.rig = LiveRig(robot, LiveSettings(load, cells=cells, **stops))
        self.limits = drive_limits(robot, 1.0 / DT, **limits)
        self.drives = Drives(self.limits)
        self.estimator = LiveEstimator(self.model)
        self.sensors = encoder_groups(self.model, SensorSettings(), 0)
        self.estimate = None

    def command(self, mode, values):
        """Command all motors: ``position`` [rad], ``velocity`` [rad/s] or ``effort`` [N m]."""
        order = checked_command(self.limits, mode, values)
        self.drives.command(order, self.rig.time_s)

    def step(self):
        """Advance by a millisecond; the newest estimate is then in ``estimate``."""
        rig = self.rig
        count = rig.steps + 1
        angle = self.drives.next(count, count * DT, DT, rig.motor_effort)
        if not rig.step(angle):
            self.drives.stopped(rig.motor_angle)
        angle = np.concatenate([rig.motor_angle, rig.joint_angle])[None]
        unread = np.zeros(angle.shape)
        truth = truth_table(angle, unread, unread, rig.tension[None])
        for group in self.sensors:
            read = group.take(np.array([rig.time_s]), truth)
            for stamp_s, values in zip(read.stamps, read.position, strict=True):
                stamp_ns = FIRST_NS + round(stamp_s * 1e9)
                _, outputs = self.estimator.feed(group.kind, stamp_ns, group.names, values)
                self.estimate = outputs[-1] if outputs else self.estimate

    def tensions(self):
        """The newest estimate: tensions [N], standard deviations [N] and status of all elements."""
        one = self.estimate
        if one is None:
            return np.empty(0), np.empty(0), np.empty(0, dtype=int)
        return one.tension, one.tension_stddev, one.status.astype(int)


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
            speed = law.allowed(wished, *loop.tensions())[0] if limited else wished
            loop.command("velocity", speed)
            loop.step()
            largest = max(largest, loop.rig.tension.max())
        return largest

    return Effect("tension_limiter", "largest true tension [N]", peak(False), peak(True))


def smooth_target(time_s, amplitude=0.4, frequency_hz=0.4):
    """A sine that starts from rest: angle [rad], speed [rad/s] and acceleration [rad/s^2]."""
    grown = amplitude * (1.0 - np.exp(-((time_s / 0.5) ** 3)))
    return differences(time_s, grown * np.sin(2.0 * np.pi * frequency_hz * time_s))


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
                added = law.update(DT, *loop.tensions())
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
