"""The services of the estimator: reset, tare and set_preload."""

from __future__ import annotations

from collections.abc import Callable

from cdrj_msgs.srv import SetPreload
from rclpy.node import Node
from std_srvs.srv import Trigger

from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.foundation.text import counted


class EstimatorServices:
    """Offers ``~/reset``, ``~/tare`` and ``~/set_preload`` of a live estimator."""

    def __init__(
        self,
        node: Node,
        live: LiveEstimator,
        *,
        forget: Callable[[], None],
        forget_clock: Callable[[], None],
        show: Callable[[], None],
        is_silent: Callable[[], bool],
        timeout_s: float,
    ) -> None:
        """Open the services.

        Args:
            node: the node that offers them.
            live: the estimator that they change.
            forget: called when the last estimate no longer holds.
            forget_clock: called when the stamps to come may be those of another clock.
            show: called when the preloads have changed.
            is_silent: whether there was no estimate for ``timeout_s``.
            timeout_s: time without estimate after which the pose is unknown [s].
        """
        self._node, self._live = node, live
        self._forget, self._forget_clock, self._show = forget, forget_clock, show
        self._is_silent, self._timeout_s = is_silent, timeout_s
        self._offered = [
            node.create_service(Trigger, "~/reset", self._on_reset),
            node.create_service(Trigger, "~/tare", self._on_tare),
            node.create_service(SetPreload, "~/set_preload", self._on_set_preload),
        ]

    def close(self) -> None:
        """Close the services."""
        for service in self._offered:
            self._node.destroy_service(service)

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._live.reset()
        self._forget_clock()
        self._forget()
        response.success = True
        response.message = (
            f"{self._live.model.robot.name}: friction history and waiting readings discarded; the "
            "estimate restarts with the next sample of every motor and joint"
        )
        return response

    def _on_tare(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            if self._live.sample is not None and self._is_silent():
                raise UsageError(
                    f"no estimate for {self._timeout_s:g} s: the present pose is not known"
                )
            response.message = self._live.tare()
            response.success = True
            self._forget()
            self._node.get_logger().info(response.message)
        except CdrjError as error:
            response.success, response.message = False, f"nothing changed: {error}"
        return response

    def _on_set_preload(
        self, request: SetPreload.Request, response: SetPreload.Response
    ) -> SetPreload.Response:
        try:
            response.message = self._live.set_preload(_preloads(request))
            response.success = True
            self._forget()
            self._show()
            self._node.get_logger().info(f"preload of {response.message}")
        except CdrjError as error:
            response.success, response.message = False, f"nothing changed: {error}"
        return response


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
