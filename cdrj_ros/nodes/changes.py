"""What users change while the estimator runs: its services and its parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol

from cdrj_msgs.srv import SetPreload
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.foundation.output import counted
from cdrj_ros.nodes.inputs import InputWatch
from cdrj_ros.nodes.parameters import apply_changes, in_force, meant, settings
from cdrj_ros.nodes.silence import StampClock
from cdrj_ros.nodes.spinning import CheckedClock, starting

SIMULATED: Final = "use_sim_time"


class Changeable(Protocol):
    """What changes use of an ``Estimation``."""

    node: CheckedClock
    live: LiveEstimator
    watch: InputWatch
    stamps: StampClock
    timeout_s: float

    @property
    def configured(self) -> bool:
        """Whether the robot is loaded."""

    def forget(self) -> None:
        """Republish the last estimate as STALE, then discard it."""


class Changes:
    """Changes of a running estimation; a refused one changes nothing and says why."""

    def __init__(self, estimation: Changeable) -> None:
        """Take changes of the node's parameters from now on; ``offer_services`` follows."""
        self._of, self._node = estimation, estimation.node
        self._showing = False
        self._node.add_pre_set_parameters_callback(
            lambda changes: meant(self._of.live if self._of.configured else None, changes)
        )
        self._node.add_on_set_parameters_callback(self._on_parameters)

    def offer_services(self) -> None:
        """Open the services."""
        self._services = [
            self._node.create_service(Trigger, "~/reset", self._on_reset),
            self._node.create_service(Trigger, "~/tare", self._on_tare),
            self._node.create_service(SetPreload, "~/set_preload", self._on_set_preload),
        ]

    def close(self) -> None:
        """Close the services."""
        for service in self._services:
            self._node.destroy_service(service)

    def show_in_force(self) -> None:
        """Set the parameters to the preloads and the friction in use."""
        self._showing = True
        try:
            with starting():
                self._node.set_parameters(in_force(self._of.live))
        finally:
            self._showing = False

    # --- services ---------------------------------------------------------------------------------

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._of.live.reset()
        self._of.stamps.forget()
        self._of.forget()
        response.success = True
        response.message = (
            f"{self._of.live.model.robot.name}: friction history and waiting readings discarded; "
            "the estimate restarts with the next sample of every motor and joint"
        )
        return response

    def _on_tare(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._answer(response, self._tare)

    def _on_set_preload(
        self, request: SetPreload.Request, response: SetPreload.Response
    ) -> SetPreload.Response:
        return self._answer(response, lambda: self._of.live.set_preload(_preloads(request)))

    def _answer(self, response: Any, change: Callable[[], str]) -> Any:
        """Make a change of the robot's numbers; the response says what it did, or why not."""
        try:
            response.message, response.success = change(), True
            self._of.forget()
            self.show_in_force()
            self._node.get_logger().info(response.message)
        except CdrjError as error:
            response.success, response.message = False, f"nothing changed: {error}"
        return response

    def _tare(self) -> str:
        if self._of.live.sample is not None and self._of.watch.silence_s() > self._of.timeout_s:
            raise UsageError(
                f"no estimate for {self._of.timeout_s:g} s: the present pose is not known"
            )
        return self._of.live.tare()

    # --- parameters -------------------------------------------------------------------------------

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Apply changes; while no robot is loaded, they are read by the next ``configure``."""
        if self._showing or not self._of.configured:
            return SetParametersResult(successful=True)
        before = self._of.live.last_ns
        try:
            self._require_changeable(changes)
            words = apply_changes(self._of.live, changes)
        except CdrjError as error:
            return SetParametersResult(successful=False, reason=f"nothing changed: {error}")
        if self._of.live.last_ns != before:
            self._of.forget()
        if words:
            self._node.get_logger().info(words)
        return SetParametersResult(successful=True)

    def _require_changeable(self, changes: list[Parameter]) -> None:
        """Refuse what is read once.

        Raises:
            UsageError: a change of such a parameter.
        """
        values = {change.name: change.value for change in changes}
        simulated = values.get(SIMULATED)
        if simulated is not None and simulated != self._node.get_parameter(SIMULATED).value:
            raise UsageError(f"{SIMULATED} is read-only after the start")
        fixed = {one.name for one in settings() if not one.changeable}
        if wrong := sorted(fixed & values.keys()):
            raise UsageError(f"{', '.join(wrong)} can only change while unconfigured")


def _preloads(request: SetPreload.Request) -> dict[str, float]:
    """The preloads of a request by cable [N].

    Raises:
        UsageError: names and preloads do not fit together.
    """
    if len(request.cable) != len(request.preload):
        raise UsageError(
            "as many preloads as cables are needed, got "
            f"{counted(len(request.cable), 'cable')} and "
            f"{counted(len(request.preload), 'preload')}"
        )
    if len(set(request.cable)) != len(request.cable):
        raise UsageError("a cable is named twice")
    return dict(zip(request.cable, request.preload, strict=True))
