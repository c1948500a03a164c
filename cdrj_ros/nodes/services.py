"""The services of a replay; most act and answer like the corresponding key."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from cdrj_msgs.srv import Burst, GetPlayback, Seek, SetRate
from rclpy.node import Node
from std_srvs.srv import Trigger

from cdrj_ros.nodes.player import Player
from cdrj_ros.replay.controls import Controls, Reply
from cdrj_ros.replay.display import counters


def offer_services(node: Node, controls: Controls, player: Player) -> None:
    """Create all services."""
    for name, act in (
        ("pause", controls.pause),
        ("resume", controls.resume),
        ("toggle_paused", controls.toggle_paused),
        ("is_paused", controls.is_paused),
        ("play_next", controls.play_next),
        ("stop", controls.stop),
    ):
        node.create_service(Trigger, f"~/{name}", _trigger(act))

    def on_set_rate(request: SetRate.Request, response: SetRate.Response) -> SetRate.Response:
        response.success, response.message = controls.set_rate(request.rate)
        response.rate = _rate(controls)
        return response

    def on_seek(request: Seek.Request, response: Seek.Response) -> Seek.Response:
        response.success, response.message = controls.seek(
            request.offset, relative=request.relative
        )
        response.offset = controls.offset_s()
        return response

    def on_burst(request: Burst.Request, response: Burst.Response) -> Burst.Response:
        response.success, response.message = controls.burst(request.number)
        response.number = request.number if response.success else 0
        return response

    def on_get_playback(
        _request: GetPlayback.Request, response: GetPlayback.Response
    ) -> GetPlayback.Response:
        return playback_state(controls, player, response)

    node.create_service(SetRate, "~/set_rate", on_set_rate)
    node.create_service(Seek, "~/seek", on_seek)
    node.create_service(Burst, "~/burst", on_burst)
    node.create_service(GetPlayback, "~/get_playback", on_get_playback)


def playback_state(controls: Controls, player: Player, response: Any) -> Any:
    """Fill in the state of the replay; the counters include all runs so far."""
    tally = player.tally
    response.message = f"{controls.is_paused().words}; {counters(tally)}"
    response.run = player.runs
    for name in ("sent", "expected", "received", "lost", "late"):
        setattr(response, name, getattr(tally, name))
    playback = controls.playback
    if playback is not None:
        response.paused = playback.paused
        response.rate = _rate(controls)
        response.offset = controls.offset_s()
        response.duration = controls.duration_s()
        time_ns = playback.begin_ns + round(controls.offset_s() * 1e9)
        sec, nanosec = divmod(max(time_ns, 0), 1_000_000_000)
        response.time = Time(sec=sec, nanosec=nanosec)
    return response


def _rate(controls: Controls) -> float:
    """Rate of the playback; 0 if it is as fast as possible or nothing is played."""
    return 0.0 if controls.playback is None else controls.playback.rate or 0.0


def _trigger(act: Callable[[], Reply]) -> Callable[[Any, Any], Any]:
    def on_request(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = act()
        return response

    return on_request
