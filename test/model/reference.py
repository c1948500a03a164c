"""One sample of a robot in plain NumPy, by the equation numbers of docs/model.md.

The module follows that page and is compared with the compiled core, with which it shares no code.
It evaluates the balance of slips that are given.  So is the geometry, which ``reference_in_space``
computes.  Speed does not matter.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from cdrj_ros.robot.description import Cable, Winch

Vector = NDArray[np.float64]

EPSILON = 1e-9
"""epsilon of (34) [N]."""

SMALLEST_TRANSMISSION = 1e-3
"""Lower limit of every eta [-]."""

RIGID = 1e9
"""sigma0 of the laws with rigid bristles [N/m]."""

DRUM_SPACING, DRUM_POINTS = 0.1, 64
"""Smallest distance [rad] of the points of (E3) at first, and how many of them are kept."""


# --- friction, section 4 -------------------------------------------------------------------------


@dataclass(frozen=True)
class Contacts:
    """Friction of one cable's contacts in one sample, arrays of shape (contacts,)."""

    law: str
    loss: Vector
    """1 - eta at the lagging speed [-]."""
    share: Vector
    """e^{-(v_f / v_s)^2} [-]."""
    drag: Vector
    """tau_b / r [N]."""
    stiffness: Vector
    """sigma0 [N/m]."""
    damping: Vector
    """sigma1 [N s/m]."""
    viscous: Vector
    """sigma2 [N s/m]."""
    breakaway: Vector
    """b of (E9) [-]."""
    shift: Vector
    """Material by which the body's side of the contact moves in the sample [m], (E25)."""


def in_cells(cable, values):
    """Values of a cable's pulleys, shape (pulleys,), for each of their contact cells."""
    return np.repeat(values, [pulley.cells for pulley in cable.pulleys])


def contacts(cable, wrap, lagged_speed, shift):
    """(37), (41), the blend, (E10) and (E28) for all contacts of a cable."""
    law, pulleys = cable.law, [pulley for pulley in cable.pulleys for _ in range(pulley.cells)]
    rigid = law in ("euler", "steady")
    friction = [pulley.friction for pulley in pulleys]
    cells = np.array([pulley.cells for pulley in pulleys], float)
    speed = np.array([f.stribeck_speed or np.inf for f in friction])
    share = np.exp(-((lagged_speed / speed) ** 2))
    fast, rest = np.array(
        [_losses(law, p, beta) for p, beta in zip(pulleys, in_cells(cable, wrap), strict=True)]
    ).reshape(-1, 2).T  # fmt: skip
    drag = [p.bearing_torque / p.radius if p.radius and law != "euler" else 0.0 for p in pulleys]

    def constant(name, limit):
        return np.array([limit if rigid else getattr(f, name) for f in friction], float)

    return Contacts(
        law, fast + (rest - fast) * share, share, np.array(drag) / cells,
        constant("bristle_stiffness", RIGID) / cells, constant("bristle_damping", 0.0) / cells,
        constant("viscous", 0.0) / cells, constant("breakaway", 1.0), shift,
    )  # fmt: skip


def _losses(law, pulley, wrap):
    """1 - eta of one cell of a pulley at high slip speed and at rest: equal parts of its wrap."""
    f, beta = pulley.friction, wrap
    rho, mu_s = (1.0, f.mu_c) if law == "euler" else (f.rho, f.mu_s)
    sliding = 1 - np.exp(-f.mu_c * beta)  # (37)
    if f.stribeck == "capstan":
        sliding_at_rest = 1 - np.exp(-mu_s * beta)
    else:
        sliding_at_rest = sliding * mu_s / f.mu_c if f.mu_c > 0 else 0.0
    ratio = f.bearing_friction * pulley.bearing_diameter / pulley.radius if pulley.radius else 0.0
    # (40) is (1 - eta)^2 = (1 + eta^2 - 2 eta cos beta) / alpha^2; with m + 1 the half sum of eta
    # and 1 / eta, its solution (41) is
    m = 2 * ratio**2 * np.sin(beta / 2) ** 2 / (1 - ratio**2)
    bearing = np.sqrt(m * (m + 2)) - m
    most = 1 - SMALLEST_TRANSMISSION
    fast = min(rho * sliding + (1 - rho) * bearing, most)
    rest = min(rho * sliding_at_rest + (1 - rho) * bearing, most)
    root = 1 / pulley.cells
    return 1 - (1 - fast) ** root, 1 - (1 - rest) ** root


def bristle_force(c, before, slip, bound):
    """(33) or (E9), integrated over the slip at constant bound."""
    way = np.where(slip >= 0, 1.0, -1.0)
    x, f, sigma = way * slip, way * before, c.stiffness
    if c.law == "lugre":
        return np.asarray(way * (bound + (f - bound) * np.exp(-sigma * x / bound)))
    f = np.clip(f, -bound, bound)
    knee = c.breakaway * bound
    bent = x > np.maximum(knee - f, 0) / sigma  # beyond the knee
    if (c.breakaway >= 1).all():  # without the part between (E9)'s knee and its bound
        return np.asarray(way * np.where(bent, bound, f + sigma * x))
    reach = np.where(c.breakaway < 1, (1 - c.breakaway) * bound / sigma, 1.0)
    start = np.maximum(f, knee)
    remaining = np.where(f < knee, x - (knee - f) / sigma, x)
    decay = np.where(c.breakaway < 1, np.exp(-np.where(bent, remaining, 0) / reach), 0)
    return np.asarray(way * np.where(bent, bound - (bound - start) * decay, f + sigma * x))


# --- one cable, sections 2 and 5 -----------------------------------------------------------------


def strain_of(cable, t):
    """(E21), for tensions of at least 0."""
    return t / cable.axial_stiffness + cable.bedding_strain * t / (t + cable.bedding_tension)


def stiffened(cable, strain):
    """(E21) solved for the tension: the root of a quadratic equation that is not negative."""
    slack = strain * cable.bedding_tension / cable.axial_stiffness
    half = 0.5 * (strain - cable.bedding_strain - cable.bedding_tension / cable.axial_stiffness)
    root = np.sqrt(half * half + slack)
    return np.asarray(
        cable.axial_stiffness * np.where(half > 0, half + root, slack / (root - half))
    )


def crept(cable, strain, delayed, dt):
    """(E24) at constant length: delayed strain, and unstretched length over that before."""
    c, tau = cable.creep_share, cable.creep_time
    state = np.stack([np.maximum(strain, 0), delayed])
    taut = _relaxed(c, dt / tau) @ state
    loose = np.stack([strain, delayed * np.exp(-dt / tau)])
    free = (1 + loose[1]) / (1 + delayed)
    after = taut[0] * np.exp(-dt / cable.flow_time)
    slack = strain <= 0
    return np.where(slack, loose[1], taut[1]), np.where(slack, free, (1 + strain) / (1 + after))


@cache
def _relaxed(share, times):
    """Change of strain and delayed strain while an element relaxes, in times of its creep_time."""
    return np.asarray(expm(times * np.array([[-share, 1.0], [share, -1.0]])))


@dataclass
class Chain:
    """One cable in one sample: what is given, and (E11) as a function of the fluxes."""

    cable: Cable
    length: Vector
    """L_i of every segment now [m]."""
    before: Vector
    """l_i at the sample before, with what has crept since [m]."""
    delayed: Vector
    """Delayed strain of every segment [-]."""
    bristle: Vector
    """f_i at the sample before [N]."""
    contacts: Contacts
    entered: float
    """s_1 of the sample: material from the first node's drum [m]."""
    left: float
    """s_n of the sample: material onto the last node's drum [m]."""
    dt: float

    def material(self, fluxes):
        """(E2), with s from one sample to the next."""
        s = np.concatenate([[self.entered], fluxes, [self.left]])
        return np.asarray(self.before - np.diff(s))

    def tension(self, fluxes):
        """(E1), or (E21)."""
        taut = np.maximum(self.length / self.material(fluxes) - 1.0, 0)
        return np.asarray(self.cable.axial_stiffness * taut if not self.cable.bedding_strain else
                          stiffened(self.cable, taut))  # fmt: skip

    def friction(self, fluxes, t):
        """Friction with its viscous parts, and the bristle force alone [N]; bound by (E8).

        ``t`` are the tensions with these fluxes; slip is against the body, (E25).
        """
        c = self.contacts
        slips = fluxes + c.shift
        if c.law == "none":
            return slips * 0, slips * 0
        pull = np.maximum(t[:-1], t[1:])
        force = bristle_force(c, self.bristle, slips, c.loss * pull + c.drag + EPSILON)
        if self.dt == 0:
            return force, force
        rate = c.damping * c.share * (force - self.bristle) / (c.stiffness * self.dt)
        return force + rate + c.viscous * slips / self.dt, force

    def imbalance(self, fluxes):
        """The largest of (E11) [N]."""
        t = self.tension(fluxes)
        return float(np.abs(np.diff(t) - self.friction(fluxes, t)[0]).max(initial=0.0))


# --- drum (E3) -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Drum:
    """Material on a drum as a piecewise linear function of the wound angle."""

    angle: Vector
    """[rad], increasing."""
    material: Vector
    """[m]."""
    rate_below: float
    """[m/rad] below the first point."""
    spacing: float = DRUM_SPACING
    """[rad]."""


def turn(drum, angle, rate):
    """(E3): the last point is the present one; winding writes at ``rate``, unwinding reads."""
    if angle >= drum.angle[-1]:
        material = drum.material[-1] + rate * (angle - drum.angle[-1])
        kept, spacing = drum.angle.size, drum.spacing
        index = np.arange(kept)
        if kept > 1 and angle - drum.angle[-2] <= spacing:
            index = index[:-1]
        elif kept == DRUM_POINTS:
            index, spacing = np.append(index[:-1:2], kept - 1), 2 * spacing
    else:
        spacing = drum.spacing
        index = np.flatnonzero(drum.angle < angle)
        material = float(np.interp(angle, drum.angle, drum.material))
        if index.size == 0:
            material = drum.material[0] + drum.rate_below * (angle - drum.angle[0])
    return Drum(
        np.append(drum.angle[index], angle), np.append(drum.material[index], material),
        drum.rate_below, spacing,
    )  # fmt: skip


# --- one sample of the robot, sections 2 and 6 ---------------------------------------------------


@dataclass(frozen=True)
class History:
    """State between two samples, all cables one after another: of segments and contacts."""

    length: Vector
    material: Vector
    delayed: Vector
    bristle: Vector
    slip_speed: Vector
    lagged_speed: Vector
    angle: Vector
    """Of motors, then joints."""
    bearing: Vector
    """Friction torque of motors, then joints [N m]."""
    drums: tuple[Drum | None, ...]
    """Of both ends of every cable; None where there is no winch."""


@dataclass(frozen=True)
class Outputs:
    """Results of one sample, section 6."""

    tension: Vector
    force: NDArray[np.float64]
    """Shape (pulleys, 3)."""
    magnitude: Vector
    friction: Vector
    slip_speed: Vector
    motor_effort: Vector
    joint_effort: Vector
    imbalance: Vector
    """Largest of every cable [N]."""


def sample(robot, rest, pose, earlier, history, angles, slips, dt):
    """History and results of a sample; (E11) is evaluated, not solved.

    Args:
        robot: the description.
        rest, pose: geometry in the reference pose and now.
        earlier: geometry at the sample before; None for the first sample, as the history.
        history: None for the first sample.
        angles: of motors and joints [rad] or [m].
        slips: of all contacts since the sample before [m].
        dt: time since the sample before [s].
    """
    prepared = [
        _prepared(robot, c, rest, pose, earlier, history, angles[0], dt)
        for c in range(len(robot.cables))
    ]
    chains = [chain for chain, _ in prepared]
    fluxes = [slips[rows(robot, c)[1]] - k.contacts.shift for c, k in enumerate(chains)]
    solved = list(zip(chains, fluxes, strict=True))
    tensions = [chain.tension(flux) for chain, flux in solved]
    bristle = [k.friction(f, t)[1] for (k, f), t in zip(solved, tensions, strict=True)]
    speed = slips / dt if dt > 0 else 0 * slips
    lag = np.concatenate(
        [
            in_cells(cable, np.array([p.friction.stribeck_lag for p in cable.pulleys]))
            for cable in robot.cables
        ]
    )
    lagged = history.lagged_speed if history else 0 * slips
    angle, bearing, passive = _axes(robot, history, *angles)
    after = History(
        np.concatenate([k.length for k in chains]),
        np.concatenate([chain.material(flux) for chain, flux in solved]),
        np.concatenate([k.delayed for k in chains]), np.concatenate(bristle), speed,
        (lag * lagged + dt * speed) / (lag + dt), angle, bearing,
        tuple(drum for _, ends in prepared for drum in ends),
    )  # fmt: skip
    residual = np.array([chain.imbalance(flux) for chain, flux in solved])
    return after, _outputs(robot, pose, np.concatenate(tensions), speed, passive, residual)


def parts(robot, c):
    """Elements and pulleys of cable c among all of the robot."""
    first = sum(len(cable.nodes) for cable in robot.cables[:c])
    n = len(robot.cables[c].nodes)
    return slice(first - c, first - c + n - 1), slice(first - 2 * c, first - 2 * c + n - 2)


def rows(robot, c):
    """Segments and contacts of cable c among all of the robot."""
    counts = [sum(pulley.cells for pulley in cable.pulleys) for cable in robot.cables]
    first = sum(counts[:c])
    return slice(first + c, first + c + counts[c] + 1), slice(first, first + counts[c])


def free_segments(cable):
    """The segment of a cable that holds the free length of every element."""
    return np.cumsum([0] + [pulley.cells for pulley in cable.pulleys])


def segments(cable, length, arc):
    """Lengths between the middles of contacts [m], from those of elements and arcs.

    An arc consists of equal cells; between those of a body that the cable does not touch remains
    a micrometre.
    """
    found, beside = [], 0.0
    for k, (one, pulley) in enumerate(zip(length, (*cable.pulleys, None), strict=True)):
        if pulley is None:
            found.append(one - beside)
            break
        between = arc[k] / pulley.cells
        if pulley.cells > 1:
            between = max(between, 1e-6)
        taken = 0.5 * between * (pulley.cells - 1)
        found.extend([one - beside - taken, *(pulley.cells - 1) * [between]])
        beside = taken
    return np.array(found)


def _shift(robot, c, earlier, pose, stretch):
    """(E25), (E26): material by which the middle of every contact moves along its body [m].

    Args:
        robot: the description.
        c: the cable.
        earlier, pose: geometry at the sample before and now.
        stretch: 1 + strain of every segment at the sample before.
    """
    cable, (_, pulleys) = robot.cables[c], parts(robot, c)
    moved = (pose.middle - earlier.middle)[pulleys]
    grown = (pose.arc - earlier.arc)[pulleys]
    ways = [
        one + more * ((np.arange(pulley.cells) + 0.5) / pulley.cells - 0.5)
        for pulley, one, more in zip(cable.pulleys, moved, grown, strict=True)
    ]
    return np.concatenate([*ways, np.zeros(0)]) / (0.5 * (stretch[:-1] + stretch[1:]))


def _prepared(robot, c, rest, pose, earlier, history, motor, dt):
    """A cable's chain and its turned drums; without a history, one tension throughout."""
    cable = robot.cables[c]
    elements, pulleys = parts(robot, c)
    own, touching = rows(robot, c)
    laid = pose.laid[2 * c : 2 * c + 2]
    length = segments(cable, pose.length[elements], pose.arc[pulleys])
    length[0] -= laid[0]  # what lies on an end keeps the strain at which it was laid on
    length[-1] -= laid[1]
    stretch = 1 + strain_of(cable, cable.preload)
    wrap, shift = pose.wrap[pulleys], np.zeros(length.size - 1)
    if history is not None:
        strained = np.maximum(history.length[own] / history.material[own], 1.0)
        shift = _shift(robot, c, earlier, pose, strained)
        bodies = [pulley.kind in ("cylinder", "sphere") for pulley in cable.pulleys]
        anew = (earlier.wrap[pulleys] == 0.0) & np.array(bodies, bool)
        wrap = np.where(anew, 0.0, wrap)  # touched again: friction begins at the next sample
    lagged = history.lagged_speed[touching] if history else 0 * shift
    friction = contacts(cable, wrap, lagged, shift)
    drums = []
    given = [0.0, 0.0]
    for end, node in enumerate((cable.nodes[0], cable.nodes[-1])):
        radius = node.effective_radius if isinstance(node, Winch) else node.radius
        if radius == 0.0:
            drums.append(None)
            continue
        angle = laid[end] / radius
        if isinstance(node, Winch):
            for name, share in node.motors:
                m = [motor.name for motor in robot.motors].index(name)
                angle += node.winding * share * (motor[m] - robot.motors[m].reference_angle)
        if history is None:
            rate = radius / stretch
            drums.append(Drum(np.array([angle]), np.array([rate * angle]), rate))
            given[end] = -rate * angle
        else:
            e, old = (own.start, own.stop - 1)[end], history.drums[2 * c + end]
            strained = max(history.length[e] / history.material[e], 1.0)
            new = turn(old, angle, radius / strained)
            drums.append(new)
            given[end] = old.material[-1] - new.material[-1]
    if history is None:
        total = rest.length[elements].sum() / stretch + sum(given)  # (E2)
        before, bristle, given = length * total / length.sum(), 0 * lagged, [0.0, 0.0]
        delayed = 0 * length + cable.creep_share * strain_of(cable, cable.preload)
    else:
        before, bristle = history.material[own], history.bristle[touching]
        strain = history.length[own] / before - 1
        delayed, growth = crept(cable, strain, history.delayed[own], dt)
        before = before * growth
    chain = Chain(cable, length, before, delayed, bristle, friction, given[0], -given[1], dt)
    return chain, drums


def _axes(robot, history, motor, joint):
    """(E13): angles, friction torques and passive torques of motors and joints."""
    angle = np.concatenate([motor, joint])
    passive = [axis.passive for axis in robot.axes]
    most = np.array([p.bearing_torque for p in passive])
    bearing = np.zeros(angle.size)
    if history is not None:
        stiffness = np.array([p.bearing_stiffness for p in passive])
        bearing = np.clip(history.bearing + stiffness * (angle - history.angle), -most, most)
    spring = np.array([p.spring_stiffness for p in passive])
    rest = np.array([p.spring_rest for p in passive])
    return angle, bearing, -bearing - spring * (angle - rest)


def _outputs(robot, pose, tension, speed, passive, residual):
    """Nodal forces and their magnitudes (38), efforts (E12)."""
    names = [motor.name for motor in robot.motors]
    motor_effort, forces, magnitudes, frictions = np.zeros(len(names)), [], [], []
    free = []
    speeds = []
    for c, cable in enumerate(robot.cables):
        elements, pulleys = parts(robot, c)
        t, beta = tension[rows(robot, c)[0]][free_segments(cable)], pose.wrap[pulleys]
        free.append(t)
        before, behind = t[:-1], t[1:]
        for end, (node, pull) in enumerate(((cable.nodes[0], t[0]), (cable.nodes[-1], t[-1]))):
            if isinstance(node, Winch):
                lever = pose.drum[2 * c + end]
                for name, share in node.motors:
                    motor_effort[names.index(name)] -= node.winding * share * lever * pull
        cells, own = [pulley.cells for pulley in cable.pulleys], speed[rows(robot, c)[1]]
        speeds.extend(np.mean(part) for part in np.split(own, np.cumsum(cells)[:-1]) if part.size)
        if cable.placed:
            along = t[:, None] * pose.direction[elements]
            force = np.diff(along, axis=0)
            magnitudes.append(np.linalg.norm(force, axis=1))
        else:  # along the bisector, and across it
            force = np.stack([(before + behind) * np.sin(beta / 2),
                              (behind - before) * np.cos(beta / 2), 0 * beta], axis=1)  # fmt: skip
            squared = (behind - before) ** 2 + 4 * before * behind * np.sin(beta / 2) ** 2
            magnitudes.append(np.sqrt(squared))  # (38)
        forces.append(force)
        frictions.append(behind - before)
    sign = np.array([axis.effort_sign for axis in robot.axes], float)
    published = np.concatenate(free)
    cables = np.concatenate([motor_effort, -published @ pose.arm])  # (E12), (E27)
    effort = sign * (cables + passive)
    return Outputs(
        published, np.concatenate(forces), np.concatenate(magnitudes), np.concatenate(frictions),
        np.array(speeds), effort[: len(names)], effort[len(names) :], residual,
    )  # fmt: skip
