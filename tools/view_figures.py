"""Renew the pictures of docs/view.md with a headless Chromium, as `make figures` does.

view_desk.png and view_phone.png show the sample recording, light on a desk and dark on a phone;
wrist.gif shows the wrist in motion, simulated here: its jaws open and close while they grip.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image
from selenium.webdriver.common.keys import Keys

ROOT: Final = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "test"))

from support.browser import chromium  # noqa: E402

import cdrj_ros as cdrj  # noqa: E402
from cdrj_ros.recordings.writer import BagWriter  # noqa: E402

FIGURES: Final = ROOT / "docs" / "figures"
BAG: Final = ROOT / "bags" / "prototype_preload_36_26"

DESK: Final = (1400, 900)
PHONE: Final = (400, 800)

LOADED_S: Final = 60.0
"""Maximum time until a page is complete [s]."""

SETTLED_S: Final = 8.0
"""Time after which a page that no longer changes is drawn [s]."""

MOVING: Final = (1460, 460)
"""Size of the window of the animation [px]."""

BETWEEN: Final = (340, 40, 880, 400)
"""Its part between the panels: left, upper, right and lower end [px]."""

FRAMES: Final = 40
"""Pictures of the animation, one every PERIOD_S / FRAMES of the motion."""

PERIOD_S: Final = 4.0
"""Duration of the motion, which repeats [s]."""

FRAME_S: Final = 1.0
"""Time after which the page shows another time of the recording [s]."""

SMALL: Final = (700, 300)
"""Size of the window while the recording plays, because software renders slowly [px]."""

PAUSE: Final = """
const text = document.body.innerText;
const button = [...document.querySelectorAll("button")].find(b => b.innerText === "pause");
if (button && parseFloat(text.split(" s of ")[0].split("\\n").pop()) > 6.0) button.click();
return !button;
"""
"""Pauses the recording after six seconds; returns whether it is paused."""

CLOSE: Final = (
    "document.querySelectorAll('.mantine-Notification-closeButton').forEach(b => b.click())"
)
"""Closes the notice that the browser renders in software."""


def known() -> str:
    """The robot that has positions, with the standard deviations of the one that has none."""
    robots = ROOT / "config" / "robots"
    _, _, stated = (robots / "prototype.yaml").read_text().partition("\nuncertainty:")
    return (robots / "prototype_positions.yaml").read_text() + "\nuncertainty:" + stated


@contextmanager
def shown(bag: Path, robot: str, *options: str) -> Iterator[str]:
    """Run `view` on a bag; yields the page's address."""
    command = [sys.executable, "-m", "cdrj_ros.commands.view", str(bag), "--robot", robot]
    process = subprocess.Popen(
        [*command, "--port", "0", *options], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        if not line.startswith("view: "):
            raise SystemExit(f"view did not start: {line}")
        yield line.removeprefix("view: ").strip()
    finally:
        process.terminate()
        process.wait()


def wait_for(browser: Any, condition: str) -> None:
    """Repeat a script until it returns true."""
    until = time.monotonic() + LOADED_S
    while not browser.execute_script(condition):
        if time.monotonic() > until:
            raise SystemExit("the page is not complete")
        time.sleep(0.2)


def resize(browser: Any, size: tuple[int, int]) -> None:
    """Set the size of the window [px]."""
    width, height = size
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < height},
    )


@contextmanager
def browsing(folder: Path, size: tuple[int, int]) -> Iterator[Any]:
    """Start a browser with a window of the given size [px]; ``folder`` holds its profile."""
    with chromium(folder, *size) as browser:
        resize(browser, size)
        yield browser


def picture(folder: Path, address: str, size: tuple[int, int], path: Path) -> None:
    """Take a picture of the page in a window of the given size [px]."""
    with browsing(folder, (min(size[0], SMALL[0]), min(size[1], SMALL[1]))) as browser:
        browser.get(address)
        wait_for(browser, "return document.body.innerText.includes(' of ')")
        wait_for(browser, PAUSE)
        resize(browser, size)
        time.sleep(SETTLED_S)
        browser.get(address)  # the camera is aimed while the page loads
        wait_for(browser, "return document.body.innerText.includes(' of ')")
        time.sleep(SETTLED_S)
        browser.execute_script(CLOSE)
        time.sleep(2.0)
        browser.save_screenshot(str(path))
    Image.open(path).convert("RGB").quantize(128).save(path, optimize=True)
    print(f"view: {path.relative_to(ROOT)}")


def record_wrist(bag: Path) -> str:
    """Write a bag of the wrist: it pitches, and its jaws close on something; returns its file."""
    text = (ROOT / "config" / "robots" / "wrist.yaml").read_text()
    robot = bag.parent / "wrist.yaml"
    robot.write_text(f"{text}\nuncertainty: {{others: exact}}\n")
    model = cdrj.load(robot)
    seconds = np.arange(0.0, 2.0 * PERIOD_S, 0.002)
    phase = 2.0 * np.pi * seconds / PERIOD_S
    opened = 0.35 + 0.25 * np.cos(phase)
    joints = np.column_stack([0.5 * np.sin(phase), opened, -opened])
    motors = cdrj.follow_joints(model, joints).motor_angle
    grip = np.clip(-np.cos(phase), 0.0, None)  # the drums that close the jaws wind in further
    motors += np.outer(grip, [0.0, 0.8, 0.8, 0.0])
    truth = cdrj.simulate(model.robot, seconds, joints, motor_angle=motors)
    stamps = 1_000_000_000 + np.round(1e9 * seconds).astype(np.int64)
    topics = cdrj.Topics()
    with BagWriter(bag) as writer:
        writer.write_joint_states(topics.motors, stamps, model.layout.motors, truth.motor_angle)
        writer.write_joint_states(topics.joints, stamps, model.layout.joints, truth.joint_angle)
        writer.write_tensions("/reference/tensions", stamps, model.layout.elements, truth.tension)
    return str(robot)


def animate(folder: Path, address: str, path: Path) -> None:
    """Step the time line of the page through one period and join the pictures."""
    with browsing(folder, MOVING) as browser:
        browser.get(address)
        wait_for(browser, "return document.body.innerText.includes(' of ')")
        wait_for(browser, PAUSE.replace("6.0", "0.5"))
        (entry,) = (
            each
            for each in browser.find_elements("css selector", "input.mantine-NumberInput-input")
            if each.is_displayed()
        )
        browser.execute_script(CLOSE)
        time.sleep(FRAME_S)
        pictures = []
        for k in range(FRAMES):
            entry.send_keys(Keys.CONTROL, "a")
            entry.send_keys(f"{PERIOD_S * (1.0 + k / FRAMES) - 0.01:.2f}", Keys.ENTER)
            time.sleep(FRAME_S)
            shown = Image.open(BytesIO(browser.get_screenshot_as_png()))
            pictures.append(shown.crop(BETWEEN).convert("RGB").quantize(64))
    first, *others = pictures
    first.save(
        path, save_all=True, append_images=others, duration=round(1000 * PERIOD_S / FRAMES), loop=0
    )
    print(f"view: {path.relative_to(ROOT)}")


def main() -> int:
    """Take all pictures; returns the exit code."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        print("view: no pictures, there is no chromium with chromedriver", file=sys.stderr)
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        robot = work / "prototype_positions.yaml"
        robot.write_text(known())
        with shown(BAG, str(robot)) as address:
            picture(work / "desk", address, DESK, FIGURES / "view_desk.png")
            picture(work / "phone", f"{address}?darkMode", PHONE, FIGURES / "view_phone.png")
        with shown(work / "wrist", record_wrist(work / "wrist")) as address:
            animate(work / "moving", address, FIGURES / "wrist.gif")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
