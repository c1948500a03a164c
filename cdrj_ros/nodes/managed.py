"""The estimator as a managed node: its transitions load the robot, start and stop it."""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.nodes.estimator import EstimatorNode
from cdrj_ros.nodes.parameters import settings
from cdrj_ros.nodes.settings import declare
from cdrj_ros.nodes.spinning import starting

SUCCESS: Final = TransitionCallbackReturn.SUCCESS

ACTIVE: Final = "active"
FURTHER: Final = {
    "unconfigured": "no robot is loaded; the transition configure loads it",
    "inactive": "no estimates; the transition activate starts them",
    "finalized": "shut down; end the process",
}
"""What diagnostics say of the states without estimates."""


class ManagedEstimator(EstimatorNode, LifecycleNodeMixin):
    """An ``EstimatorNode`` whose states are those of a lifecycle node.

    - ``configure`` reads the parameters and the robot file and opens outputs and services.  If the
      robot file is invalid, the node logs why and stays unconfigured.
    - ``activate`` subscribes to the inputs: every sample is estimated and published.
    - ``deactivate`` publishes the last estimate as STALE and closes the inputs.  The next
      activation continues as a new process with the same state file does.
    - ``cleanup`` closes outputs and services and unloads the robot.  Every parameter may then be
      changed, and applies from the next ``configure``.
    - ``shutdown`` does both from any state.
    """

    def _start(self) -> None:
        declare(self, fixed=False)
        self._watch_parameters()
        LifecycleNodeMixin.__init__(self)
        self._service_change_state.callback = self._refusing(self._service_change_state.callback)
        self._diagnose()

    def _refusing(self, change: Callable[..., Any]) -> Callable[..., Any]:
        """The service's callback, without the error with which rclpy ends the node.

        It does so when asked for a transition that the present state does not have.
        """

        def on_request(
            request: ChangeState.Request, response: ChangeState.Response
        ) -> ChangeState.Response:
            wish = request.transition
            known = {one[0]: one[1] for one in self._state_machine.available_transitions}
            if wish.label in known.values() or (not wish.label and wish.id in known):
                return change(request, response)
            self.get_logger().warning(
                f"no transition {wish.label or wish.id} from {self.lifecycle_state}; there are "
                f"{', '.join(known.values()) or 'none'}"
            )
            response.success = False
            return response

        return on_request

    @property
    def lifecycle_state(self) -> str:
        """Label of the present state."""
        return str(self._state_machine.current_state[1])

    # --- transitions ------------------------------------------------------------------------------

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Load the robot."""
        names = [one.name for one in settings() if one.changeable]
        self._given = {name: self.get_parameter_or(name).value for name in names}
        try:
            with starting():
                self._configure()
        except CdrjError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return SUCCESS

    def on_activate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Start estimating."""
        self._listen()
        return SUCCESS

    def on_deactivate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Stop estimating."""
        self._pause()
        return SUCCESS

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Unload the robot."""
        self._unload()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop estimating and unload the robot."""
        if state.label == ACTIVE:
            self._pause()
        if self.configured:
            self._unload()
        return SUCCESS

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Return to unconfigured after an unexpected error in a transition."""
        self.get_logger().fatal("a transition failed unexpectedly: unconfigured")
        if self.configured:
            self._unload()
        return SUCCESS

    def _pause(self) -> None:
        """Publish the last estimate as STALE, write the state file and close the inputs."""
        for timer in self._checks:
            self.destroy_timer(timer)
        for one in self.inputs:
            one.close()
        self._forget()
        self.live.suspend()

    def _unload(self) -> None:
        """Close outputs and services; the parameters show again what was given."""
        self.configured = False
        self.topics.close()
        self._offered.close()
        del self.live, self.topics, self._offered
        gc.unfreeze()
        self.set_parameters(
            [
                Parameter(name, value=value)
                if value is not None
                else Parameter(name, Parameter.Type.DOUBLE_ARRAY, [])
                for name, value in self._given.items()
            ]
        )

    # --- parameters and diagnostics ---------------------------------------------------------------

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        if not self.configured:  # read and checked by the next transition configure
            return SetParametersResult(successful=True)
        fixed = {one.name for one in settings() if not one.changeable}
        if wrong := sorted(fixed & {change.name for change in changes}):
            reason = f"nothing changed: {', '.join(wrong)} can only change while unconfigured"
            return SetParametersResult(successful=False, reason=reason)
        return super()._on_parameters(changes)

    def _status(self, name: str) -> DiagnosticStatus:
        state = self.lifecycle_state
        if state == ACTIVE:
            status = super()._status(name)
        else:
            status = DiagnosticStatus(
                level=DiagnosticStatus.WARN,
                name=name,
                message=f"{state}: {FURTHER.get(state, 'in transition')}",
                hardware_id=self.live.model.robot.name if self.configured else "",
            )
        status.values.append(KeyValue(key="lifecycle state", value=state))
        return status
