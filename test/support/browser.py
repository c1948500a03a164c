"""A headless Chromium that renders in software; tests are skipped where there is none."""

import shutil
from contextlib import contextmanager

import pytest

OPTIONS = (
    "--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-renderer-backgrounding", "--disable-backgrounding-occluded-windows",
    "--disable-background-timer-throttling", "--disable-gpu-watchdog",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars",
)  # fmt: skip


@contextmanager
def chromium(folder, width, height):
    """Start a browser with a new profile in ``folder``; yields selenium's driver."""
    webdriver = pytest.importorskip("selenium.webdriver")
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if not (browser and driver):
        pytest.skip("there is no Chromium with chromedriver")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for option in (*OPTIONS, f"--window-size={width},{height}", f"--user-data-dir={folder}"):
        options.add_argument(option)
    one = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        one.set_page_load_timeout(60.0)
        one.set_script_timeout(60.0)
        yield one
    finally:
        one.quit()
