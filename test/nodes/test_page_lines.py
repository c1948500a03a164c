"""Lines of `ros2` on the pages run as printed, with the installed executables and services.

`ros2` itself is not on PyPI; its `run`, `service call`, `topic pub`, `topic echo --once`,
`param set` and `lifecycle set` are followed here, and what `launch` of the estimator alone starts.
Launch files have tests of their own.
"""

from __future__ import annotations

import importlib
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic
from typing import IO, Any

import pytest
import yaml
from support.forked import Forked
from support.page_lines import shown_files, write_files

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0
AGAIN_S = 15.0
PAGES = (
    "controllers.md", "install.md", "recordings.md", "rig_node.md", "tutorial.md", "view.md",
)  # fmt: skip
NEEDS = {"view.md": ("viser", "rich")}
FOLLOWED = (
    "ros2 run cdrj_ros ", "ros2 service call", "ros2 topic ", "ros2 param set",
    "ros2 lifecycle set", "ros2 launch cdrj_ros estimator.launch.py", "python3 ", "estimator ",
)  # fmt: skip


def lines_of(page: str) -> list[str]:
    """Lines that can be followed; those with a file that the reader is to have are left out."""
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)
    lines = re.sub(r"\\\n", " ", "".join(blocks)).splitlines()
    return [
        line for line in lines if line.startswith(FOLLOWED) and not re.search("my_|/path/", line)
    ]


class Shell:
    """Follows lines: starts processes, calls services, publishes."""

    def __init__(self, node: Any, executables: Path, folder: Path) -> None:
        self.node, self._executables, self._folder = node, executables, folder
        self.started: list[tuple[str, Forked | subprocess.Popen[bytes], Path]] = []
        self._timers: list[Any] = []

    def follow(self, line: str) -> None:
        line = line.replace("$PWD", str(self._folder))
        words = shlex.split(line.partition(" | ")[0].rstrip("& "), comments=True)
        match words[1:] if words[0] == "ros2" else words:
            case ["run", "cdrj_ros", name, *rest]:
                self._start(name, rest)
            case ["estimator", *rest]:
                self._start("estimator", rest)
            case ["python3", script, *rest]:
                self._run(
                    Path(script).stem, [sys.executable, str(ROOT / "examples" / script), *rest]
                )
            case ["service", "call", name, kind, *given]:
                self._call(name, kind, yaml.safe_load(given[0]) if given else {})
            case ["launch", "cdrj_ros", "estimator.launch.py", *given]:
                parameters = [word for one in given for word in ("-p", one)]
                self._start("estimator", ["--ros-args", *parameters])
            case ["topic", "pub", "--once", name, kind, given]:
                self._publish(name, kind, yaml.safe_load(given))
            case ["topic", "pub", "-r", rate, name, kind, given]:
                self._keep_publishing(float(rate), name, kind, yaml.safe_load(given))
            case ["topic", "echo", "--once", name]:
                self._wait_for(name)
            case ["param", "set", node, name, value]:
                self._set(node, name, float(value))
            case ["lifecycle", "set", node, transition]:
                self._change(node, transition)
            case _:
                raise AssertionError(f"not followed: {line}")

    def until(self, condition: Callable[[], object], what: str) -> None:
        import rclpy

        deadline = self.node.get_clock().now().nanoseconds + round(PATIENCE_S * 1e9)
        while not condition():
            rclpy.spin_once(self.node, timeout_sec=0.02)
            now = self.node.get_clock().now().nanoseconds
            assert now < deadline, f"waited in vain for {what}\n{self.said()}"

    def said(self) -> str:
        return "\n".join(f"{name}: {path.read_text()}" for name, _, path in self.started)

    def running(self, name: str) -> Callable[[], bool]:
        """Whether there is a node of that name for each such process that has not done its work.

        ``view`` of a recording has no node: it says where its page is.
        """
        ours = [(process, path) for other, process, path in self.started if other == name]
        if name == "view":
            return lambda: all("http://" in path.read_text() for _, path in ours)
        return lambda: (
            sum(name in other for other in self.node.get_node_names() if other != "test")
            >= sum(process.poll() != 0 for process, _ in ours)
        )

    def _start(self, name: str, arguments: list[str]) -> None:
        """Start an installed executable, as a fork that need not import again."""
        assert (self._executables / name).exists()
        with self._output(name) as said:
            self.started.append((name, Forked(name, arguments, said.fileno()), Path(said.name)))

    def _run(self, name: str, command: list[str]) -> None:
        with self._output(name) as said:
            process = subprocess.Popen(command, cwd=ROOT, stdout=said, stderr=said)
        self.started.append((name, process, Path(said.name)))

    def _output(self, name: str) -> IO[bytes]:
        return (self._folder / f"{len(self.started)}_{name}.txt").open("wb")

    def _ask(self, kind: Any, name: str, request: Any) -> Any:
        """A service's answer; a call that is lost while nodes discover each other is repeated."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, name)
        sent: list[Any] = []

        def answered() -> bool:
            now = monotonic()
            if not sent or now > sent[-1][0] + AGAIN_S:
                sent.append((now, client.call_async(request)))
            return any(future.done() for _, future in sent)

        self.until(answered, f"the answer of {name}")
        return next(future.result() for _, future in sent if future.done())

    def _call(self, name: str, kind: str, given: dict[str, Any]) -> None:
        service, answers = type_of(kind), []

        def succeeds() -> bool:  # a service may be there before the recording has begun to play
            answers.append(self._ask(service, name, filled(service.Request(), given)))
            return bool(answers[-1].success)

        self.until(succeeds, f"success of {name}")

    def _publish(self, name: str, kind: str, given: dict[str, Any]) -> None:
        publisher = self.node.create_publisher(type_of(kind), name, 10)
        self.until(publisher.get_subscription_count, f"a subscription of {name}")
        publisher.publish(filled(type_of(kind)(), given))

    def _keep_publishing(self, rate: float, name: str, kind: str, given: dict[str, Any]) -> None:
        publisher = self.node.create_publisher(type_of(kind), name, 10)
        assert given["header"].pop("stamp") == "now"
        message = filled(type_of(kind)(), given)

        def publish() -> None:
            message.header.stamp = self.node.get_clock().now().to_msg()
            publisher.publish(message)

        self._timers.append(self.node.create_timer(1.0 / rate, publish))

    def _wait_for(self, name: str) -> None:
        from rclpy.qos import qos_profile_sensor_data

        found: list[Any] = []
        self.until(lambda: self.node.count_publishers(name), f"a publisher of {name}")
        (kind,) = dict(self.node.get_topic_names_and_types())[name]
        self.node.create_subscription(type_of(kind), name, found.append, qos_profile_sensor_data)
        self.until(lambda: found, name)

    def _set(self, node: str, name: str, value: float) -> None:
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        (result,) = self._ask(SetParameters, f"{node}/set_parameters", request).results
        assert result.successful, result.reason

    def _change(self, node: str, transition: str) -> None:
        from lifecycle_msgs.srv import ChangeState, GetState

        request = ChangeState.Request()
        request.transition.label = transition
        self._ask(ChangeState, f"{node}/change_state", request)
        state = self._ask(GetState, f"{node}/get_state", GetState.Request()).current_state
        assert state.label == {"configure": "inactive", "activate": "active"}[transition]

    def end(self) -> None:
        """Interrupt all that still runs; it must have run well until then."""
        for _, process, _ in reversed(self.started):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for name, process, path in self.started:
            code = process.wait(PATIENCE_S)
            assert code in (0, 130), f"{name} ended with {code}: {path.read_text()}"
            assert "Traceback" not in path.read_text(), path.read_text()


def type_of(name: str) -> Any:
    package, kind, own = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), own)


def filled(message: Any, given: dict[str, Any]) -> Any:
    for name, value in given.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


@pytest.fixture
def shell(node: Any, executables: Path, tmp_path: Path) -> Iterator[Shell]:
    one = Shell(node, executables, tmp_path)
    yield one
    for _, process, _ in one.started:
        if process.poll() is None:
            process.kill()
            process.wait()


@pytest.mark.parametrize("page", PAGES)
def test_the_lines_of_a_page_run(
    page: str, shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    for library in NEEDS.get(page, ()):
        pytest.importorskip(library)
    lines = lines_of(page)
    assert lines
    if page == "tutorial.md":
        write_files(shown_files("docs/tutorial.md"), tmp_path)
    for line in lines:
        shell.follow(line)
    for name, _, _ in shell.started:
        shell.until(shell.running(name), f"the node {name}")
    shell.end()
