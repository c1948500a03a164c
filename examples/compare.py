"""Switch a controller on and off, and say what the robot's true tensions are with and without it.

    python3 compare.py --ros-args -p controller:=keep_taut

It listens to the simulated robot's /cdrj/truth/tensions (truth_rate of the rig) and prints a line
every two seconds, which the page of view shows, too. Enter switches the controller, or:

    ros2 param set /cdrj/keep_taut active false
"""

import sys
import threading

import numpy as np
import rclpy
from cdrj_msgs.msg import CableTensions
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterEvent
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

SETTLING_S, WINDOW_S, EVERY_S = 3.0, 5.0, 2.0
"""Time after a switch that is left out, length of what is compared, time between two lines [s]."""

CAPTIONS = {
    "": "no controller: the motors follow the motion",
    "keep_taut": "keep_taut: cables as loose as possible, none slack; it lowers the mean",
    "tension_limiter": "tension_limiter: no tension beyond its limit; it lowers the largest",
    "collision_stop": "collision_stop: motors stop at a collision; it lowers the largest",
    "friction_feedforward": "friction_feedforward: the joint follows more exactly",
}


class CompareNode(Node):
    """Prints smallest, mean and largest tension, and those of the other state of the switch."""

    def __init__(self, **options):
        super().__init__("compare", namespace="cdrj", **options)
        self.controller = self.declare_parameter("controller", "").value
        self.active, self.kept, self.seen, self.since_s = True, {}, [], None
        self.client = AsyncParameterClient(self, self.controller or "none")
        self.create_subscription(CableTensions, "truth/tensions", self.on_tensions, 10)
        self.create_subscription(ParameterEvent, "/parameter_events", self.on_event, 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(EVERY_S, self.on_timer)
        print(CAPTIONS.get(self.controller, self.controller), flush=True)
        if self.controller:
            print(f"Enter, or ros2 param set /cdrj/{self.controller} active false, switches it off")

    def on_tensions(self, message):
        """Keep the tensions of the last seconds."""
        stamp_s = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        self.since_s = self.since_s or stamp_s
        if stamp_s > self.since_s + SETTLING_S:
            self.seen.append((stamp_s, np.array(message.tension)))
        while self.seen and self.seen[0][0] < stamp_s - WINDOW_S:
            self.seen.pop(0)

    def on_event(self, event):
        """Notice that the controller has been switched."""
        if not event.node.endswith(f"/{self.controller}"):
            return
        for one in event.changed_parameters:
            if one.name == "active":
                self.active = one.value.bool_value
                self.seen, self.since_s = [], None
                print(f"{self.controller} is {self.state(self.active)}", flush=True)

    def on_timer(self):
        """Print a line once the last seconds are known."""
        caption = CAPTIONS.get(self.controller, self.controller)
        if not self.seen or self.seen[-1][0] - self.seen[0][0] < 0.9 * WINDOW_S:
            self.show(f"{caption}. {self.state(self.active)}")
            return
        tension = np.array([row for _, row in self.seen])
        self.kept[self.active] = (tension.min(), tension.mean(), tension.max())
        said = [f"{self.state(one)}: {self.text(self.kept[one])}"
                for one in (self.active, not self.active) if one in self.kept]  # fmt: skip
        print("   before, ".join(said), flush=True)
        self.show(f"{caption}. {'; before, '.join(said)}")

    def show(self, text):
        """Publish what runs, for the page of view."""
        message = DiagnosticArray(status=[DiagnosticStatus(name="compare: caption", message=text)])
        message.header.stamp = self.get_clock().now().to_msg()
        self.diagnostics.publish(message)

    def state(self, active):
        """Words for a state of the switch."""
        return ("on" if active else "off") if self.controller else "tensions"

    @staticmethod
    def text(numbers):
        """Smallest, mean and largest tension."""
        names = ("smallest", "mean", "largest")
        return ", ".join(f"{name} {one:.1f} N" for name, one in zip(names, numbers, strict=True))

    def switch(self):
        """Switch the controller off or on."""
        if self.controller and self.client.services_are_ready():
            self.client.set_parameters([Parameter("active", value=not self.active)])


def main():
    """Run until Ctrl-C."""
    rclpy.init()
    node = CompareNode()

    def listen():
        for _ in sys.stdin:
            node.executor.create_task(node.switch)

    if sys.stdin is not None and sys.stdin.isatty():
        threading.Thread(target=listen, daemon=True).start()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        if rclpy.ok():  # otherwise Ctrl-C came while a message was being published
            raise


if __name__ == "__main__":
    main()
