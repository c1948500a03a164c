"""Renew the pictures and figures of README.md and docs: `make figures`.

- runs the demonstration, which measures docs/demo.json, and writes its errors into the table of
  README.md;
- draws docs/figures/fig*.png with examples/paper;
- with Chromium and chromedriver, takes pictures of the beginning of report.html (docs/report.png)
  and of `view`: view_desk.png and view_phone.png show the sample recording, light on a desk and
  dark on a phone; wrist.gif shows the wrist in motion, simulated here: its jaws open and close
  while they grip.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "test"))

from support.browser import chromium  # noqa: E402

import cdrj_ros as cdrj  # noqa: E402
from cdrj_ros.model.prepared import robot_path  # noqa: E402
from cdrj_ros.recordings.writer import BagWriter  # noqa: E402
from cdrj_ros.robot.writer import exact_copy  # noqa: E402

README = ROOT / "README.md"
MEASURED = ROOT / "docs" / "demo.json"
FIGURES = ROOT / "docs" / "figures"
BAG = ROOT / "bags" / "prototype_preload_36_26"

ROWS = {
    "last element of the upper / lower cable": ("tension/upper/8", "tension/lower/8"),
    "third nodal force, upper / lower": ("nodal_force/upper/3", "nodal_force/lower/3"),
}
"""Rows of the README's table of errors, and their channels."""

REPORT = (1265, 1245)
DESK, PHONE = (1400, 900), (400, 800)
SMALL = (700, 300)
"""While a recording plays, because software renders slowly."""
MOVING = (1460, 460)
"""Sizes of windows [px]."""
BETWEEN = (340, 40, 880, 400)
"""The part of MOVING between the panels: left, upper, right and lower end [px]."""

WITHOUT_TABLES = "<style>.tables, .tables ~ *, dl.rows, h2:has(+ .tables) { display: none }</style>"
"""Style that hides the tables of a report."""
LOADED_S = 60.0
"""Maximum time until a page is complete [s]."""
SETTLED_S = 8.0
"""Time after which a page that no longer changes is drawn [s]."""
FRAME_S = 1.0
"""Time after which the page shows another time of the recording [s]."""
FRAMES = 40
PERIOD_S = 4.0
"""Pictures of the animation, and duration of the motion, which repeats [s]."""

COMPLETE = "return document.body.innerText.includes(' of ')"
PAUSED = """
const text = document.body.innerText;
const button = [...document.querySelectorAll("button")].find(b => b.innerText === "pause");
if (button && parseFloat(text.split(" s of ")[0].split("\\n").pop()) > 6.0) button.click();
return !button;
"""
"""Pauses the recording after six seconds; returns whether it is paused."""
CLOSE = "document.querySelectorAll('.mantine-Notification-closeButton').forEach(b => b.click())"
"""Closes the notice that the browser renders in software."""


def readme_with(text, channels):
    """README.md with the errors of the demonstration.

    Raises:
        ValueError: a row is missing.
    """
    errors = {name: 100.0 * one["mean_relative_error"] for name, one in channels.items()}
    cells = {
        label: " / ".join(f"{errors[name]:.2f} %" for name in names)
        for label, names in ROWS.items()
    }
    tensions = [error for name, error in errors.items() if name.startswith("tension/")]
    cells["all 16 element tensions"] = f"{np.mean(tensions):.2f} %"
    for label, cell in cells.items():
        row = re.compile(rf"^(\| {re.escape(label)} \|) [^|]* \|", re.MULTILINE)
        text, found = row.subn(rf"\1 {cell} |", text)
        if found != 1:
            raise ValueError(f"README.md has {found} rows {label!r}, expected 1")
    return text


def known():
    """The robot that has positions, with the standard deviations of the one that has none."""
    robots = ROOT / "config" / "robots"
    _, _, stated = (robots / "prototype.yaml").read_text().partition("\nuncertainty:")
    return (robots / "prototype_positions.yaml").read_text() + "\nuncertainty:" + stated


def record_wrist(bag):
    """Write a bag of the wrist: it pitches, and its jaws close on something; returns its file."""
    robot = exact_copy(robot_path("wrist"), bag.parent)
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


@contextmanager
def shown(folder, bag, robot):
    """Run `view` on a bag; yields the page's address, where the recording is paused."""
    program = "from cdrj_ros.commands.entry import view; view()"
    command = [sys.executable, "-c", program, str(bag), "--robot", robot]
    process = subprocess.Popen([*command, "--port", "0"], stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        if not line.startswith("view: "):
            raise SystemExit(f"view did not start: {line}")
        address = line.removeprefix("view: ").strip()
        with browsing(folder / "paused", address, SMALL) as browser:
            wait_for(browser, COMPLETE)
            wait_for(browser, PAUSED)
        yield address
    finally:
        process.terminate()
        process.wait()


def wait_for(browser, condition):
    """Repeat a script until it returns true."""
    until = time.monotonic() + LOADED_S
    while not browser.execute_script(condition):
        if time.monotonic() > until:
            raise SystemExit("the page is not complete")
        time.sleep(0.2)


@contextmanager
def browsing(profile, address, size):
    """A browser that shows a page in a window of the given size [px]."""
    width, height = size
    inner = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < height}
    with chromium(profile, width, height) as browser:
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", inner)
        browser.get(address)
        yield browser


def picture(profile, address, size, path):
    """Take a picture of a page that no longer changes."""
    from PIL import Image

    with browsing(profile, address, size) as browser:
        time.sleep(SETTLED_S)
        browser.execute_script(CLOSE)
        time.sleep(2.0)
        browser.save_screenshot(str(path))
    Image.open(path).convert("RGB").quantize(128).save(path, optimize=True)
    print(path.relative_to(ROOT))


def animate(profile, address, path):
    """Step the time line of the page through one period and join the pictures."""
    from PIL import Image
    from selenium.webdriver.common.keys import Keys

    with browsing(profile, address, MOVING) as browser:
        wait_for(browser, COMPLETE)
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
            screen = Image.open(BytesIO(browser.get_screenshot_as_png()))
            pictures.append(screen.crop(BETWEEN).convert("RGB").quantize(64))
    first, *others = pictures
    each_ms = round(1000 * PERIOD_S / FRAMES)
    first.save(path, save_all=True, append_images=others, duration=each_ms, loop=0)
    print(path.relative_to(ROOT))


def picture_pages(work):
    """Take the pictures of the report and of `view`."""
    report = work / "report.html"
    page = (ROOT / "report.html").read_text(encoding="utf-8")
    report.write_text(page.replace("</head>", f"{WITHOUT_TABLES}</head>", 1), encoding="utf-8")
    picture(work / "report", report.as_uri(), REPORT, ROOT / "docs" / "report.png")
    robot = work / "prototype_positions.yaml"
    robot.write_text(known())
    with shown(work, BAG, str(robot)) as address:
        picture(work / "desk", address, DESK, FIGURES / "view_desk.png")
        picture(work / "phone", f"{address}?darkMode", PHONE, FIGURES / "view_phone.png")
    with shown(work, work / "wrist", record_wrist(work / "wrist")) as address:
        animate(work / "moving", address, FIGURES / "wrist.gif")


def run(*command):
    """Run one of the project's programs; raise an error if it fails."""
    subprocess.run([str(part) for part in command], cwd=ROOT, check=True)


def main():
    """Renew everything."""
    run(sys.executable, ROOT / "tools" / "demo.py")
    channels = json.loads(MEASURED.read_text(encoding="utf-8"))["channels"]
    README.write_text(readme_with(README.read_text("utf-8"), channels), encoding="utf-8")
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        run(sys.executable, "-m", "examples.paper", "--out", work, "--force")
        for drawn in work.glob("fig*.png"):
            shutil.copy(drawn, FIGURES / drawn.name)
        if shutil.which("chromium") and shutil.which("chromedriver"):
            picture_pages(work)
        else:
            print("no pictures of pages: there is no chromium with chromedriver", file=sys.stderr)


if __name__ == "__main__":
    main()
