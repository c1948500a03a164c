"""The prototype's mechanism for MuJoCo: two frictionless tendons over the same fourteen pulleys.

The cables lie in a plane and follow the robot file's spans, radii and wrap angles; the lower cable
mirrors the upper one.  The rolling joint is modelled as two hinges of the same angle, 2R apart, the
winch as a slide that pulls the two cables in opposite directions.  Radii, wraps and spans are those
of the prototype in its middle pose; over the joint's range the cable stays on every pulley.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, degrees, sin

from cdrj_ros.robot.description import Profile, Pulley, Robot, Winch

ROLLING_RADIUS = 0.04
"""R of the rolling joint [m], assumed as in the simulated rig."""

STRAND = 0.06
"""Distance of the strands from the middle of the joint [m]: w of eq. (2)."""

ON_BASE = 4
"""Pulleys of a cable before the rolling joint; the others move with the link."""

Point = tuple[float, float]


@dataclass(frozen=True)
class _Turtle:
    """A point with a heading in the plane, from which the path is drawn."""

    x: float
    y: float
    heading: float

    def ahead(self, distance: float) -> _Turtle:
        """Move straight ahead by a distance [m]."""
        return _Turtle(
            self.x + distance * cos(self.heading),
            self.y + distance * sin(self.heading),
            self.heading,
        )

    def aside(self, distance: float) -> Point:
        """Point at a distance to the left [m]."""
        return self.x - distance * sin(self.heading), self.y + distance * cos(self.heading)

    def round(self, signed_radius: float, wrap: float) -> tuple[Point, Point, _Turtle]:
        """Follow an arc; returns its centre, a point outside its middle and its end."""
        side = 1.0 if signed_radius > 0.0 else -1.0
        cx, cy = self.aside(signed_radius)
        turned = self.heading + side * wrap

        def at(heading: float, scale: float) -> Point:
            r = scale * signed_radius
            return cx + r * sin(heading), cy - r * cos(heading)

        outside = at(self.heading + side * 0.5 * wrap, 2.0)
        return (cx, cy), outside, _Turtle(*at(turned, 1.0), turned)


def middle(profiles: tuple[Profile, ...]) -> float:
    """Span [m] or wrap [rad] in the middle of the joint's range."""
    return sum(float(profile.value[profile.value.size // 2]) for profile in profiles)


@dataclass(frozen=True)
class _Routed:
    """One cable as MJCF fragments: sites on the winch, bodies on base and link, tendon path."""

    winch: str
    base: str
    link: str
    path: str


def along(
    start: _Turtle, pulleys: tuple[Pulley, ...], spans: list[float]
) -> list[tuple[Point, Point, _Turtle]]:
    """Per pulley: centre, a point outside the arc, and the middle of the next span."""
    places = []
    turtle = start.ahead(0.5 * spans[0])
    for k, pulley in enumerate(pulleys):
        turn = (
            -1.0 if k % 2 == 0 else 1.0
        )  # alternate the turns so that the path does not close on itself
        turtle = turtle.ahead(0.5 * spans[k])
        centre, outside, turtle = turtle.round(turn * pulley.radius, middle(pulley.wrap))
        turtle = turtle.ahead(0.5 * spans[k + 1])
        places.append((centre, outside, turtle))
    return places


def start_of(pulleys: tuple[Pulley, ...], spans: list[float]) -> _Turtle:
    """Start of the path that crosses the rolling contact straight ahead at ``STRAND``."""
    crossing = along(_Turtle(0.0, 0.0, 0.0), pulleys, spans)[ON_BASE - 1][2]
    turned = along(_Turtle(0.0, 0.0, -crossing.heading), pulleys, spans)[ON_BASE - 1][2]
    return _Turtle(ROLLING_RADIUS - turned.x, STRAND - turned.y, -crossing.heading)


def _routed(
    name: str, pulleys: tuple[Pulley, ...], spans: list[float], mirror: float, height: float
) -> _Routed:
    bodies: tuple[list[str], list[str]] = [], []
    start = start_of(pulleys, spans)
    path = [f'<site site="{name}_winch"/>']
    for k, (pulley, place) in enumerate(zip(pulleys, along(start, pulleys, spans), strict=True)):
        moving = k >= ON_BASE
        centre, outside, end = (
            f"{x - 2.0 * ROLLING_RADIUS * moving:.9g} {mirror * y:.9g} 0"
            for x, y in (place[0], place[1], (place[2].x, place[2].y))
        )
        end = f"{end.removesuffix(' 0')} {height * (-1) ** k:.9g}"
        bodies[moving].append(
            f'<geom name="{name}_{k}" type="cylinder" size="{pulley.radius:.9g} 0.005" '
            f'pos="{centre}"/><site name="{name}_{k}_side" pos="{outside}"/>'
            f'<site name="{name}_{k}_end" pos="{end}"/>'
        )
        path.append(
            f'<geom geom="{name}_{k}" sidesite="{name}_{k}_side"/><site site="{name}_{k}_end"/>'
        )
    winch = f'<site name="{name}_winch" pos="{start.x:.9g} {mirror * start.y:.9g} 0"/>'
    return _Routed(winch, "".join(bodies[0]), "".join(bodies[1]), "".join(path))


def mjcf(robot: Robot, height: float = 0.0) -> str:
    """MJCF of the prototype: qpos is [winch, first hinge, second hinge].

    Args:
        robot: the prototype.
        height: the sites between the pulleys lie alternately this far above and below the plane
            [m], so that the cables cross it and run round the pulleys as helices.
    """
    cables = {}
    for cable, mirror in zip(robot.cables, (1.0, -1.0), strict=True):
        if not isinstance(cable.nodes[0], Winch):
            raise ValueError(f"{cable.name} does not begin at a winch")
        spans = [middle(profiles) for profiles in cable.spans]
        cables[cable.name] = _routed(cable.name, cable.pulleys, spans, mirror, height)
    winch, base, link = (
        "\n".join(getattr(cable, part) for cable in cables.values())
        for part in ("winch", "base", "link")
    )
    tendons = "\n".join(
        f'<spatial name="{name}" stiffness="1000">{cable.path}</spatial>'
        for name, cable in cables.items()
    )
    low, high = (degrees(bound) for bound in (robot.joints[0].lower, robot.joints[0].upper))
    return f"""
<mujoco model="{robot.name}">
  <compiler angle="degree"/>
  <default><geom contype="0" conaffinity="0" mass="0.01"/></default>
  <worldbody>
    {base}
    <body name="winch">
      <joint name="winch" type="slide" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
      {winch}
    </body>
    <body name="contact">
      <joint name="first" axis="0 0 1" range="{low} {high}"/>
      <inertial pos="0 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>
      <body name="link" pos="{2 * ROLLING_RADIUS} 0 0">
        <joint name="second" axis="0 0 1" range="{low} {high}"/>
        {link}
      </body>
    </body>
  </worldbody>
  <tendon>{tendons}</tendon>
</mujoco>
"""
