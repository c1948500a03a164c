"""Renew the pictures of docs/view.md with a headless Chromium, as `make figures` does.

The sample recording is shown: view_desk.png light on a desk, view_phone.png dark on a phone.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from PIL import Image

ROOT: Final = Path(__file__).resolve().parent.parent
FIGURES: Final = ROOT / "docs" / "figures"
BAG: Final = ROOT / "bags" / "prototype_preload_36_26"

DESK: Final = (1400, 900)
PHONE: Final = (400, 800)

LOADED_S: Final = 60.0
"""Maximum time until a page is complete [s]."""

SETTLED_S: Final = 8.0
"""Time after which a page that no longer changes is drawn [s]."""

SMALL: Final = (700, 300)
"""Size of the window while the recording plays, because software renders slowly [px]."""

PAUSE: Final = """
const text = document.body.innerText;
const button = [...document.querySelectorAll("button")].find(b => b.innerText === "pause");
if (button && parseFloat(text.split(" s of ")[0].split("\\n").pop()) > 6.0) button.click();
return !button;
"""
"""Pauses the recording after six seconds; returns whether it is paused."""

OPTIONS: Final = (
    "--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars",
)  # fmt: skip


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


def picture(folder: Path, address: str, size: tuple[int, int], path: Path) -> None:
    """Take a picture of the page in a window of the given size [px]."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    width, height = size
    for option in (*OPTIONS, f"--window-size={width},{height}", f"--user-data-dir={folder}"):
        options.add_argument(option)
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    browser: Any = webdriver.Chrome(options=options, service=service)
    try:
        resize(browser, (min(width, SMALL[0]), min(height, SMALL[1])))
        browser.get(address)
        wait_for(browser, "return document.body.innerText.includes(' of ')")
        wait_for(browser, PAUSE)
        resize(browser, size)
        time.sleep(SETTLED_S)
        browser.get(address)  # the camera is aimed while the page loads
        wait_for(browser, "return document.body.innerText.includes(' of ')")
        time.sleep(SETTLED_S)
        browser.execute_script(  # a notice that the browser renders in software
            "document.querySelectorAll('.mantine-Notification-closeButton').forEach(b => b.click())"
        )
        time.sleep(2.0)
        browser.save_screenshot(str(path))
    finally:
        browser.quit()
    Image.open(path).convert("RGB").quantize(128).save(path, optimize=True)
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
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
