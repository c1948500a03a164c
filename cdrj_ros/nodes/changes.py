"""What users change while the estimator runs: its services and its parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from cdrj_msgs.srv import SetPreload
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from cdrj_ros.estimation.changes import preloads_of
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.foundation.output import counted
from cdrj_ros.nodes.parameters import FRICTION, TRACKING, UNSET, bandwidth, settings
from cdrj_ros.nodes.settings import as_double
from cdrj_ros.nodes.spinning import starting
from cdrj_ros.robot.parameters import number_at

if TYPE_CHECKING:
    from cdrj_ros.nodes.estimation import Estimation

SIMULATED: Final = "use_sim_time"


class Changes:
    """Changes of a running estimation; a refused one changes nothing and says why."""

    def __init__(self, estimation: Estimation) -> None:
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


def in_force(live: LiveEstimator) -> list[Parameter]:
    """Current values of the parameters that services and the state file can change."""
    robot = live.model.robot
    document = dict(robot.document)
    return [
        Parameter("preload", value=[float(cable.preload) for cable in robot.cables]),
        *(
            Parameter(name, value=float(number_at(document, name)))
            for name in (f"friction.{key}" for key in FRICTION)
        ),
    ]


def meant(live: LiveEstimator | None, changes: Sequence[Parameter]) -> list[Parameter]:
    """The changes with the values that they stand for.

    Integers become doubles. ``UNSET`` of ``friction.*`` becomes the robot file's value, so that the
    parameter shows the value in use; not without an estimator.
    """
    defaults = {one.name: one.default for one in settings()}
    found = []
    for change in changes:
        one = as_double(change, defaults.get(change.name))
        unset = one.name in defaults and one.name.startswith("friction.") and one.value == UNSET
        if live is not None and unset:
            document = dict(live.started.robot.document)
            one = Parameter(one.name, value=float(number_at(document, one.name)))
        found.append(one)
    return found


def apply_changes(live: LiveEstimator, changes: Sequence[Parameter]) -> str:
    """Apply all changes of parameters to a running estimator, or none of them.

    Returns:
        A description of the changes; empty if none concerns the estimator.

    Raises:
        CdrjError: a change is invalid; no change has been applied then.
    """
    given = {change.name: change.value for change in changes}
    friction = {name: float(given[name]) for name in given if name.startswith("friction.")}
    options = replace(
        live.options,
        unsure_share=float(given.get("unsure_share", live.options.unsure_share)),
        tracking=bandwidth(float(given[TRACKING])) if TRACKING in given else live.options.tracking,
    )
    preload = _by_cable(live, given["preload"]) if "preload" in given else {}
    if preload:
        preloads_of(live.model, preload)  # refuses before anything has changed
    words = []
    before = live.model
    if friction:
        words.append(live.set_numbers(friction))
    if preload:
        try:
            words.append(live.set_preload(preload))
        except CdrjError:
            if friction:
                live.use(before)
            raise
    if "unsure_share" in given:
        live.set_unsure_share(options.unsure_share)
        words.append(f"unsure_share = {options.unsure_share:g}")
    if TRACKING in given:
        live.set_tracking(options.tracking)
        words.append(f"{TRACKING} = {given[TRACKING]:g}")
    return "; ".join(words)


def _by_cable(live: LiveEstimator, given: Sequence[float] | None) -> dict[str, float]:
    """Preloads by cable [N].

    Raises:
        UsageError: there is not one for each.
    """
    if given is None:
        raise UsageError("preload cannot be unset while running")
    cables = [cable.name for cable in live.model.robot.cables]
    if len(given) != len(cables):
        raise UsageError(
            f"preload needs {len(cables)} tensions, of {', '.join(cables)}; got {len(given)}"
        )
    return dict(zip(cables, given, strict=True))
