"""A MuJoCo model whose tendon has friction on what it wraps: the torque comes from our model.

    python mujoco_bridge.py                # prints the hysteresis with friction and without
    python mujoco_bridge.py --png loop.png

MuJoCo computes the dynamics; its tendon has one tension everywhere.  Here ``import_robot``'s
conversion turns the tendon into a cable, and at every time step the cable model computes its
tensions from the angles of winch and joint.  The cable's torque on the joint is MuJoCo's
``qfrc_applied``.
"""

import argparse
import tempfile
from pathlib import Path

import mujoco
import numpy as np

import cdrj_ros as cdrj

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.0005" gravity="0 0 -9.81"/>
  <worldbody>
    <site name="drum" pos="-0.30 0 0.05"/>
    <geom name="guide" type="cylinder" fromto="-0.15 -0.01 0.10 -0.15 0.01 0.10" size="0.02"
          contype="0" conaffinity="0"/>
    <site name="over_guide" pos="-0.15 0 0.15"/>
    <body name="arm">
      <joint name="elbow" axis="0 1 0" range="-1 1" damping="0.05"/>
      <geom type="capsule" fromto="0.02 0 0 0.20 0 0" size="0.01" mass="0.5"
            contype="0" conaffinity="0"/>
      <site name="end" pos="0.10 0 0.02"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="lift">
      <site site="drum"/>
      <geom geom="guide" sidesite="over_guide"/>
      <site site="end"/>
    </spatial>
  </tendon>
</mujoco>
"""
"""An arm that a tendon holds against its weight; it runs over a guide."""

STIFFNESS, PRELOAD = 4000.0, 20.0  # EA and tension in the model's pose [N]
SWING, PERIOD_S = 1.0, 4.0  # amplitude of the drum's angle [rad]


class Bridge:
    """A MuJoCo model with cables in place of its tendons."""

    def __init__(self, path, friction):
        """Read the model.

        Args:
            path: MJCF file; its spatial tendons become cables.
            friction: coefficient of every cable on what it touches.
        """
        self.physics = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.physics)
        file = Path(path).with_suffix(".yaml")
        cdrj.import_mjcf(path, file)
        numbers = {"cables.lift.axial_stiffness": STIFFNESS, "cables.lift.preload": PRELOAD}
        self.model = cdrj.load(file, {**numbers, "friction.mu_c": friction})
        joints = [self.physics.joint(joint.name) for joint in self.model.robot.joints]
        self.places = np.array([joint.qposadr[0] for joint in joints])
        self.speeds = np.array([joint.dofadr[0] for joint in joints])
        self.state, self.time_ns = cdrj.initial_state(self.model), 0

    def step(self, motor_angle):
        """Advance by a time step with these angles of the drums [rad]; returns the estimate."""
        self.time_ns += round(self.physics.opt.timestep * 1e9)
        joint_angle = self.data.qpos[self.places].copy()
        sample = cdrj.Sample(self.time_ns, np.asarray(motor_angle), joint_angle)
        self.state, estimate = cdrj.step(self.model, self.state, sample)
        self.data.qfrc_applied[self.speeds] = estimate.values[self.model.layout.joint_effort]
        mujoco.mj_step(self.physics, self.data)
        return estimate


def loop(friction, periods=2):
    """Swing the drum; returns angles of drum and joint [rad], the drum's torque and tensions."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        path.write_text(ARM, encoding="utf-8")
        bridge = Bridge(path, friction)
    rows = []
    layout = bridge.model.layout
    for k in range(round(periods * PERIOD_S / bridge.physics.opt.timestep)):
        drum = SWING * np.sin(2.0 * np.pi * k * bridge.physics.opt.timestep / PERIOD_S)
        values = bridge.step([drum]).values
        joint = bridge.data.qpos[bridge.places[0]]
        rows.append([drum, joint, *values[layout.motor_effort], *values[layout.tension]])
    return np.array(rows)[-round(PERIOD_S / bridge.physics.opt.timestep) :]


def lost(rows):
    """Work that the drum does in the last swing [J]: the area of its loop."""
    torque, angle = np.append(rows[:, 2], rows[0, 2]), np.append(rows[:, 0], rows[0, 0])
    return abs(float(np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(angle))))


def draw(runs, path):
    """Write the picture: the drum's torque over the joint's angle."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, box = pyplot.subplots(figsize=(6.5, 4.2), layout="constrained")
    for (name, rows), colour in zip(runs.items(), ("#1f6fb4", "#b0402c"), strict=True):
        box.plot(np.degrees(rows[:, 1]), 1e3 * rows[:, 2], color=colour, label=name, lw=1.2)
    box.set(xlabel="joint angle [deg]", ylabel="torque of the drum [mN m]")
    box.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    figure.savefig(path, dpi=110)


def main():
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--png", metavar="FILE", help="picture to write")
    arguments = parser.parse_args()
    runs = {"without friction": loop(0.0), "with friction, μ = 0.15": loop(0.15)}
    for name, rows in runs.items():
        ratio = np.max(rows[:, 3] / np.maximum(rows[:, -1], 1e-9))
        print(f"{name}: {1e3 * lost(rows):.2f} mJ lost per swing, tension at the drum up to "
              f"{ratio:.3f} times that at the joint")  # fmt: skip
    if arguments.png:
        draw(runs, arguments.png)


if __name__ == "__main__":
    main()
