"""Rig, estimator and a controller in one process, without ROS: every run gives the same numbers.

    loop = ClosedLoop("prototype", payload=0.3)
    loop.command("velocity", [0.5])
    for _ in range(1000):
        loop.step()
        print(loop.estimate.tension - loop.rig.tension)

The controllers in examples/ are tested and measured with it (docs/ros2_control.md).
"""

import numpy as np

from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.commands import checked_command
from cdrj_ros.simulation.drives import Drives, drive_limits
from cdrj_ros.simulation.live import LiveRig, LiveSettings
from cdrj_ros.simulation.load import make_load, usual_load
from cdrj_ros.simulation.sensors import SensorSettings, encoder_groups, truth_table

RATE_HZ = 1000.0
STEP_NS = 1_000_000
FRESH_S = 1e-4  # the angles are as old as their stamps say, to this [s]
FIRST_NS = 1_000_000_000  # a stamp of 0 denotes a missing stamp


class ClosedLoop:
    """The simulated rig with its encoders, and the estimator that reads them."""

    def __init__(
        self, robot, payload=0.3, damping=0.05, joint=0, seed=0, cells=8, exact=False, **limits
    ):
        """Put the rig at rest.

        Args:
            robot: robot file, or the name of an installed one.
            payload: mass that the free joint carries [kg].
            damping: of the free joint [N m s/rad].
            joint: index of the joint that moves freely.
            seed: of the encoders' random errors.
            cells: number of contact cells per pulley.
            exact: whether the numbers of the robot file are exact, as if identified.
            limits: of the motors (``drive_limits``) and ``lower`` and ``upper`` end stop [rad].
        """
        self.model = load_model(robot)
        if exact:
            kinds = (("motors", self.model.layout.motors), ("joints", self.model.layout.joints))
            clocks = [f"{kind}.{name}.clock_offset" for kind, names in kinds for name in names]
            known = {"others": "exact", "parameters": clocks, "stddev": [FRESH_S] * len(clocks)}
            document = {**self.model.robot.document, "uncertainty": known}
            self.model = prepare(build_robot(document, self.model.robot.source))
        robot = self.model.robot
        stops = {name: limits.pop(name) for name in ("lower", "upper") if name in limits}
        load = make_load(usual_load(robot, joint), payload, damping)
        self.rig = LiveRig(robot, LiveSettings(load, cells=cells, joint=joint, **stops))
        self.limits = drive_limits(robot, RATE_HZ, **limits)
        self.drives = Drives(self.limits)
        self.estimator = LiveEstimator(self.model)
        self.sensors = encoder_groups(self.model, SensorSettings(), seed)
        self.estimate = None
        self.readings = {}

    @property
    def stamp_ns(self):
        """The present time on the encoders' clock [ns]."""
        return FIRST_NS + self.rig.steps * STEP_NS

    def command(self, mode, values):
        """Command all motors: ``position`` [rad], ``velocity`` [rad/s] or ``effort`` [N m]."""
        order = checked_command(self.limits, mode, values)
        self.drives.command(order, self.rig.time_s)

    def step(self):
        """Advance by a millisecond; the newest estimate is then in ``estimate``."""
        rig = self.rig
        count = rig.steps + 1
        angle = self.drives.next(count, count / RATE_HZ, 1.0 / RATE_HZ, rig.motor_effort)
        if not rig.step(angle):
            self.drives.stopped(rig.motor_angle)
        angle = np.concatenate([rig.motor_angle, rig.joint_angle])[None]
        unread = np.zeros(angle.shape)
        truth = truth_table(angle, unread, unread, rig.tension[None])
        for group in self.sensors:
            read = group.take(np.array([rig.time_s]), truth)
            for stamp_s, values in zip(read.stamps, read.position, strict=True):
                self.readings[group.kind] = values
                stamp_ns = FIRST_NS + round(stamp_s * 1e9)
                _, outputs = self.estimator.feed(group.kind, stamp_ns, group.names, values)
                self.estimate = outputs[-1] if outputs else self.estimate

    def tensions(self):
        """The newest estimate with the arrays of ``/cdrj/tensions``.

        Returns:
            Names, tensions [N], standard deviations [N] and status flags of all elements.
        """
        if self.estimate is None:
            return [], np.empty(0), np.empty(0), np.empty(0, dtype=int)
        status = self.estimate.status.astype(int)
        one = self.estimate
        return self.model.layout.elements, one.tension, one.tension_stddev, status
