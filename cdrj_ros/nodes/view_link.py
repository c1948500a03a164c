"""The connection of the page to a running estimator: parameters, services, state in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from queue import SimpleQueue
from time import monotonic
from typing import Any, Final

import numpy as np
from markupsafe import Markup
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from cdrj_ros.model.packing import STALE
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.feed import Rate
from cdrj_ros.nodes.parameters import FRICTION, settings
from cdrj_ros.nodes.view_inputs import Inputs
from cdrj_ros.report.status import age_words
from cdrj_ros.view.history import Snapshot
from cdrj_ros.view.panels import Controls, SliderRange, filled

READ_S: Final = 1.0
"""Time between two readings of the parameters in force [s]."""

PATIENCE_S: Final = 3.0
"""Time after which a request that was not answered is given up [s]."""

PRELOAD: Final = "preload"


def slider_ranges(model: Model) -> list[SliderRange]:
    """Sliders for the preload of every cable and the common friction."""
    ranges = []
    for cable in model.robot.cables:
        round_number = float(f"{max(4.0 * cable.preload, 20.0):.2g}")
        limit = min(cable.maximum_tension, round_number)
        text = "Tension of the cable in the reference pose. A change restarts the estimate."
        ranges.append(
            SliderRange(f"{PRELOAD}/{cable.name}", f"preload {cable.name}", text, "N", 0.0, limit,
                 min(cable.preload, limit))
        )  # fmt: skip
    described = {one.name: one for one in settings()}
    pulleys = [pulley for cable in model.robot.cables for pulley in cable.pulleys]
    for key in FRICTION:
        largest = max((float(getattr(pulley.friction, key)) for pulley in pulleys), default=0.0)
        one = described[f"friction.{key}"]
        high = min(max(3.0 * largest, LEAST.get(key, 1.0)), one.high)
        words = one.description.partition(" Common value")[0]
        ranges.append(
            SliderRange(one.name, key.replace("_", " "), words, one.unit, 0.0, high, largest)
        )
    return ranges


LEAST: Final[Mapping[str, float]] = {"mu_c": 0.5, "mu_s": 0.5, "rho": 2.0, "bearing_friction": 0.5}
"""Smallest upper end of a slider."""


class EstimatorLink:
    """Requests to the estimator's services.

    ``change`` and ``press`` may be called in any thread; everything else runs in that of the node.
    """

    def __init__(self, node: Node, model: Model) -> None:
        """Create the clients.

        Args:
            node: the caller, in the namespace of the estimator.
            model: gives the cables.
        """
        self.name = node.resolve_service_name("estimator")
        self._cables = [cable.name for cable in model.robot.cables]
        self._get = node.create_client(GetParameters, f"{self.name}/get_parameters")
        self._set = node.create_client(SetParameters, f"{self.name}/set_parameters")
        self._triggers = {
            press: node.create_client(Trigger, f"{self.name}/{press}") for press in TRIGGERS
        }
        self._wishes: SimpleQueue[tuple[str, float | None]] = SimpleQueue()
        self._wanted: dict[str, float] = {}
        self._preload: list[float] = []
        self._waiting: dict[str, tuple[Any, Any, float]] = {}
        self._read_s = -READ_S
        self.controls: Controls | None = None

    def change(self, name: str, value: float) -> None:
        """Ask for a value of a slider."""
        self._wishes.put((name, value))

    def press(self, name: str) -> Callable[[], None]:
        """The function of a button that calls a service of ``TRIGGERS``."""
        return lambda: self._wishes.put((name, None))

    def poll(self) -> bool:
        """Send what is wanted; returns whether the estimator is there."""
        there = bool(self._set.service_is_ready())
        if self.controls is None:
            return there
        self.controls.enable(there)
        pressed = self._collect()
        if not there:
            self._wanted.clear()
            self._preload = []
            return False
        self._give_up()
        for name in pressed:
            self._send(name, self._triggers[name], Trigger.Request(), self._on_trigger)
        if self._wanted and "set" not in self._waiting:
            self._send_wanted()
        elif monotonic() - self._read_s > READ_S and "get" not in self._waiting:
            self._read_s = monotonic()
            names = [PRELOAD, *(f"friction.{key}" for key in FRICTION)]
            self._send("get", self._get, GetParameters.Request(names=names), self._on_values)
        return True

    def _collect(self) -> list[str]:
        """Take what the page asked for; of several values of one slider only the last counts."""
        pressed = []
        while not self._wishes.empty():
            name, value = self._wishes.get()
            if value is None:
                pressed.append(name)
            else:
                self._wanted[name] = value
        return pressed

    def _send_wanted(self) -> None:
        changes = []
        preload = list(self._preload)
        for name, value in self._wanted.items():
            kind, _, cable = name.partition("/")
            if kind == PRELOAD and preload:
                preload[self._cables.index(cable)] = value
            elif kind != PRELOAD:
                changes.append(Parameter(name, value=value))
        if preload and preload != self._preload:
            changes.append(Parameter(PRELOAD, value=preload))
        names, self._wanted = tuple(self._wanted), {}
        messages: list[ParameterMessage] = [one.to_parameter_msg() for one in changes]
        if messages:
            request = SetParameters.Request(parameters=messages)
            self._send("set", self._set, request, lambda reply: self._on_set(names, reply))

    def _send(self, key: str, client: Any, request: Any, then: Callable[[Any], None]) -> None:
        if key in self._waiting:
            return

        def on_reply(future: Any) -> None:
            if self._waiting.pop(key, None) is not None and future.result() is not None:
                then(future.result())

        future = client.call_async(request)
        self._waiting[key] = (client, future, monotonic())
        future.add_done_callback(on_reply)

    def _give_up(self) -> None:
        """Forget requests that an estimator received that has ended since."""
        for key, (client, future, since) in list(self._waiting.items()):
            if monotonic() - since > PATIENCE_S:
                del self._waiting[key]
                client.remove_pending_request(future)
                self._say(f"no answer from {self.name}")

    def _on_trigger(self, reply: Any) -> None:
        self._say(reply.message if reply.success else _refused(reply.message))

    def _on_set(self, names: tuple[str, ...], reply: Any) -> None:
        reasons = [one.reason for one in reply.results if not one.successful]
        if self.controls is not None and reasons:
            for name in names:
                self.controls.release(name)
        self._say(_refused(reasons[0]) if reasons else "")
        self._read_s = -READ_S

    def _on_values(self, reply: Any) -> None:
        if len(reply.values) != 1 + len(FRICTION):
            return  # no estimator of this version
        preload, *friction = reply.values
        self._preload = list(preload.double_array_value)
        values = {
            f"{PRELOAD}/{cable}": value
            for cable, value in zip(self._cables, self._preload, strict=False)
        }
        for key, value in zip(FRICTION, friction, strict=True):
            values[f"friction.{key}"] = float(value.double_value)
        if self.controls is not None:
            self.controls.in_force(values)

    def _say(self, words: str) -> None:
        if self.controls is not None:
            self.controls.answer(words)


def _refused(reason: str) -> Markup:
    return filled("<b>refused:</b> {}", reason)


TRIGGERS: Final[Mapping[str, str]] = {
    "tare": "Take the present pose, at rest, as the reference pose",
    "reset": "Discard the friction history; the estimate restarts",
}
"""Services of the estimator that the page calls, with an explanation."""


DIAGNOSED_S: Final = 3.0
"""Time after which a diagnosis is no longer shown [s]."""

CAPTION: Final = ": caption"
"""End of the name of a DiagnosticStatus that says what runs beside the estimator."""

LEVELS: Final = {b"\x00": "OK", b"\x01": "WARN", b"\x02": "ERROR", b"\x03": "STALE"}
"""Words of the levels of a DiagnosticStatus."""

SHOWN: Final = ("lag behind the newest reading [ms]", "readings stepped")
"""Values of the diagnosis that the page shows; the table has the flags of the elements."""


@dataclass
class Heard:
    """What has been received from the estimator beside its tensions."""

    topic: str
    """Of its tensions."""
    node: str
    """Its full name."""
    diagnosis: Any = None
    """Its last DiagnosticStatus."""
    diagnosed_s: float = -float("inf")
    """Steady time of the last diagnosis [s]."""
    rate: Rate = field(default_factory=Rate)
    caption: str = ""
    """What runs, as the last status whose name ends with ``CAPTION`` says."""
    captioned_s: float = -float("inf")
    """Steady time of that status [s]."""

    def diagnose(self, status: Any) -> None:
        """Store a DiagnosticStatus."""
        if status.name.endswith(CAPTION):
            self.caption, self.captioned_s = status.message, monotonic()
        else:
            self.diagnosis, self.diagnosed_s = status, monotonic()


def words_of(
    heard: Heard, inputs: Inputs, shown: Snapshot, there: bool, publishers: int, now_ns: int
) -> tuple[str, ...]:
    """The state in paragraphs, see ``panels.plain``.

    Args:
        heard: its diagnosis.
        inputs: when its tensions were received.
        shown: the last ones.
        there: whether the estimator offers its services.
        publishers: number of publishers of its tensions.
        now_ns: time of the clock with which stamps are compared [ns].
    """
    rate = heard.rate.hz(inputs.count)
    if inputs.fresh:
        stale = np.all(shown.status & STALE)
        state = "<b>Stale:</b> the estimator's inputs are late" if stale else "<b>Estimating</b>"
        hertz = "" if rate is None else f" · {rate:.0f} Hz"
        age = age_words((now_ns - shown.stamp_ns) * 1e-9)
        return (filled(state + "{} · {}", hertz, age), *_diagnosed(heard))
    since = f"{monotonic() - inputs.heard_s:.0f} s"
    if not there and not publishers:
        if inputs.count:
            words = "<b>No estimator:</b> {} is gone, its last tensions are {} old"
            return (filled(words, heard.node, since),)
        words = "<b>No estimator:</b> nobody publishes {}, and {} is not running"
        return (filled(words, heard.topic, heard.node),)
    if not publishers:
        return (filled("<b>No tensions:</b> nobody publishes {}", heard.topic), *_diagnosed(heard))
    silent = f"for {since}" if inputs.count else "yet"
    return (filled("<b>No tensions</b> on {} {}", heard.topic, silent), *_diagnosed(heard))


def _diagnosed(heard: Heard) -> tuple[str, ...]:
    """Caption, message and some values of the last diagnosis, unless they are old."""
    now_s, status = monotonic(), heard.diagnosis
    caption = (heard.caption,) if now_s - heard.captioned_s <= DIAGNOSED_S else ()
    if status is None or now_s - heard.diagnosed_s > DIAGNOSED_S:
        return caption
    values = {value.key: value.value for value in status.values}
    message = f"{LEVELS.get(status.level, '?')}: {status.message}"
    kept = [f"{key} {values[key]}" for key in SHOWN if values.get(key, "none") != "none"]
    details = [filled("<small>{}</small>", " · ".join(kept))] if kept else []
    return (*caption, message, *details)
