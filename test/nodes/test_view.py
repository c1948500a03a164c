"""``view`` in a headless Chromium: colours, curves, sliders, buttons, and a lost estimator."""

import io
import signal
import subprocess
import threading
from time import monotonic, sleep
from unittest.mock import MagicMock

import numpy as np
import pytest
import rclpy
from cdrj_msgs.msg import CableTensions
from rcl_interfaces.srv import GetParameters
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from support.browser import chromium

import cdrj_ros as cdrj
from cdrj_ros.model.packing import INVALID
from cdrj_ros.nodes.view_link import slider_ranges
from cdrj_ros.report.scene import LIMIT_COLOUR, tension_colour
from cdrj_ros.view.panels import Controls, SliderRange

PATIENCE_S = 60.0


FIELD = """
for (const label of document.querySelectorAll("label")) {
    if (label.textContent === arguments[0]) {
        let around = label;
        while (!around.querySelector("input[type=text]")) around = around.parentElement;
        return around.querySelector("input[type=text]");
    }
}
"""
"""Finds the number beside the slider with a label."""


def wait_for(condition, what):
    deadline = monotonic() + PATIENCE_S
    while not (found := condition()):
        assert monotonic() < deadline, f"waited in vain for {what}"
        sleep(0.1)
    return found


class Scene:
    """A view of the finger, a publisher of its tensions, an estimator, and a browser."""

    def __init__(self, view, user, browser, program):
        self.view, self.user, self.browser, self._program = view, user, browser, program
        self.names = list(view.model.layout.elements)
        self.tension, self.status, self.publishing = 18.0, 0, True
        self._publisher = user.create_publisher(CableTensions, "/cdrj/tensions", 10)
        user.create_timer(0.1, self._publish)
        self.process = None

    def _publish(self):
        if not self.publishing:
            return
        n = len(self.names)
        message = CableTensions(
            name=self.names, tension=[self.tension] * n, stddev=[0.5] * n, status=[self.status] * n
        )
        message.header.stamp = self.user.get_clock().now().to_msg()
        self._publisher.publish(message)

    def start_estimator(self):
        self.process = subprocess.Popen(
            [self._program, "--ros-args", "-p", "robot:=finger"], stderr=subprocess.DEVNULL
        )

    def stop_estimator(self):
        if self.process is not None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(PATIENCE_S)
            self.process = None

    def text(self):
        return str(self.browser.execute_script("return document.body.innerText"))

    def pixels(self):
        from PIL import Image

        picture = Image.open(io.BytesIO(self.browser.get_screenshot_as_png())).convert("RGB")
        return np.asarray(picture, float)[160:, 340:720]  # between the panels, below a notice

    @property
    def canvas(self):
        """The picture, not a plot."""
        return self.browser.find_element("css selector", "canvas[style*='pointer-events']")

    def places(self, points):
        """Where points are in the picture [px], from its middle to the right and down."""
        from viser.transforms import SO3

        height = self.canvas.size["height"]
        camera = next(iter(self.view.page.server.get_clients().values())).camera
        turned = (points - camera.position) @ SO3(camera.wxyz).as_matrix()
        scale = 0.5 * height / np.tan(0.5 * camera.fov)
        return np.asarray(scale * turned[:, :2] / turned[:, 2:])

    def red(self):
        """Share of pixels of the colour of the limit, not of the orange of a browser's notice."""
        pixels = self.pixels()
        return float((pixels[..., 0] > 2.5 * pixels[..., 1] + 20.0).mean())


@pytest.fixture(scope="module")
def scene(tmp_path_factory, executables):
    pytest.importorskip("viser")
    from cdrj_ros.nodes.view import ViewNode

    with chromium(tmp_path_factory.mktemp("browser"), 1100, 620) as browser:
        rclpy.init()
        given = {"robot": "finger", "port": 0, "rate": 5.0}
        view = ViewNode(parameter_overrides=[Parameter(k, value=v) for k, v in given.items()])
        user = Node("user")
        executor = EventsExecutor()
        for node in (view, user):
            executor.add_node(node)
        whole = Scene(view, user, browser, executables / "estimator")
        stop = threading.Event()

        def spin():
            while not stop.is_set():
                executor.spin_once(timeout_sec=0.1)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield whole
        finally:
            whole.stop_estimator()
            stop.set()
            thread.join()
            view.page.close()
            executor.shutdown()
            for node in (view, user):
                node.destroy_node()
            rclpy.try_shutdown()


@pytest.fixture(scope="module")
def page(scene):
    """The scene with the page open and the estimator running."""
    scene.start_estimator()
    scene.browser.get(scene.view.page.address)
    wait_for(lambda: scene.view.page.watched, "the browser")
    wait_for(lambda: (table := scene.view.history.table()) and table.stamp_ns.size > 2, "tensions")
    return scene


def test_nothing_is_subscribed_or_drawn_before_a_browser_comes(scene):
    ticks = scene.view.get_clock().now()
    drawn = scene.view.page.pictures
    while (scene.view.get_clock().now() - ticks).nanoseconds < 300_000_000:
        assert not scene.view.inputs.listening
        sleep(0.02)
    assert scene.view.page.pictures == drawn


def test_the_page_loads_and_says_what_it_shows(page):
    wait_for(lambda: "cdrj_ros · finger" in page.text(), "the title")
    wait_for(lambda: "Estimating" in page.text(), "the state")
    assert "deep/1" in page.text()
    assert "18.0 ± 1.0 N" in page.text()
    assert page.browser.find_elements("tag name", "canvas")


def test_cables_take_the_colour_of_a_known_tension_on_the_screen(page):
    def colour_is(wanted):
        expected = tuple(round(255.0 * part) for part in wanted)
        handles = page.view.page.drawing.cables
        return lambda: all(tuple(one.color) == expected for one in handles.values())

    cable = page.view.model.robot.cables[0]
    page.tension = cable.maximum_tension
    wait_for(colour_is(LIMIT_COLOUR), "the colour of the limit")
    wait_for(lambda: page.red() > 0.004, "red pixels")
    page.tension = 4.0
    wait_for(
        lambda: (
            tuple(page.view.page.drawing.cables["superficial/1"].color)
            == tuple(round(255.0 * x) for x in tension_colour(4.0, 4.0, 150.0))
        ),
        "the colour of the tension",
    )
    wait_for(lambda: page.red() < 0.001, "no red pixels")
    page.status = INVALID
    cables = page.view.page.drawing.cables.values()
    wait_for(lambda: all(cable.wireframe for cable in cables), "nets")
    page.status = 0
    page.tension = 18.0


def test_a_click_on_a_cable_plots_it(page):
    from selenium.webdriver import ActionChains

    view = page.view.page
    wait_for(lambda: not any(cable.wireframe for cable in view.drawing.cables.values()), "tubes")
    wanted = "extensor/1"
    canvas = page.canvas

    def click():
        """Click where the picture shows the middle of the element's vertices."""
        point = np.array(view.drawing.cables[wanted].vertices).mean(axis=0)
        place = page.places(point[None])[0]
        mouse = ActionChains(page.browser)
        mouse.move_to_element_with_offset(canvas, int(place[0]), int(place[1]))
        mouse.click().perform()
        sleep(0.3)
        return bool(view.chosen == f"element {wanted}")

    wait_for(click, "the click")
    wait_for(lambda: f"Element {wanted}" in page.text(), "the plot's words")


def test_a_slider_changes_the_parameter_of_the_estimator(page):
    from selenium.webdriver import Keys

    client = page.user.create_client(GetParameters, "/cdrj/estimator/get_parameters")
    client.wait_for_service(PATIENCE_S)
    field = wait_for(lambda: page.browser.execute_script(FIELD, "mu c"), "the slider")
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys("0.3", Keys.ENTER)

    def value():
        future = client.call_async(GetParameters.Request(names=["friction.mu_c"]))
        wait_for(future.done, "the parameter")
        return float(future.result().values[0].double_value)

    wait_for(lambda: value() == pytest.approx(0.3, abs=0.003), "the change")
    wait_for(lambda: field.get_attribute("value") == "0.3", "the value in force")
    assert page.browser.execute_script(FIELD, "preload deep [N]"), "a unit is in the label"


def test_a_refusal_is_shown_in_words(page):
    button = page.browser.find_element("xpath", "//button[.//*[text()='tare'] or text()='tare']")
    page.browser.execute_script("arguments[0].scrollIntoView(); arguments[0].click();", button)
    wait_for(lambda: "refused: nothing changed: no angles yet" in page.text(), "the refusal")


def test_the_page_outlives_the_estimator_and_says_that_it_is_gone(page):
    def slider_is_disabled():
        return bool(page.view.link.controls._sliders["friction.mu_c"].disabled)

    page.publishing = False
    wait_for(lambda: "No tensions on /cdrj/tensions for" in page.text(), "the silence")
    page.user.destroy_publisher(page._publisher)
    page.stop_estimator()
    wait_for(lambda: "/cdrj/estimator is gone" in page.text(), "the loss")
    assert slider_is_disabled()
    page.start_estimator()
    wait_for(lambda: not slider_is_disabled(), "the return")
    field = page.browser.execute_script(FIELD, "mu c")
    wait_for(lambda: field.get_attribute("value") == "0.12", "the value of the new estimator")


def test_the_subscriptions_end_with_the_last_browser(page):
    page.browser.close()
    wait_for(lambda: not page.view.inputs.listening, "the end of the subscriptions")
    drawn = page.view.page.pictures
    sleep(0.2)
    assert page.view.page.pictures == drawn


def test_a_number_box_has_the_digits_that_it_has_room_for():
    gui = MagicMock()
    limits = SliderRange("p", "preload upper", "", "N", 0.0, 73.7, 14.38812)
    controls = Controls(gui, [limits], print, {})
    (label, _, _, step, start), _ = gui.add_slider.call_args
    assert (label, step, start) == ("preload upper [N]", 0.4, 14.4)
    controls.in_force({"p": 0.0264912})
    assert gui.add_slider.return_value.value == 0.026
    controls.in_force({"p": 80.0})
    assert gui.add_slider.return_value.value == 73.7


def test_sliders_of_preloads_end_at_a_round_number():
    """It stands at the slider, where a fitted preload would have nine digits."""
    model = cdrj.load("prototype", {"cables.upper.preload": 27.11322})
    assert [one.high for one in slider_ranges(model)[:2]] == [110.0, 110.0]
