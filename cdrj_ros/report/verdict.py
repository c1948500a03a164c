"""Summary of the figures: one sentence and a few key numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from cdrj_ros.estimation.recorded_health import Alarm
from cdrj_ros.estimation.recorded_health import Verdict as HealthVerdict
from cdrj_ros.evaluation.channels import (
    ANGLE,
    FORCE_VECTOR,
    QUANTITIES,
    BagComparison,
    quantity_of,
)
from cdrj_ros.evaluation.metrics import ChannelError, Errors, mean_over_channels
from cdrj_ros.foundation.text import counted
from cdrj_ros.model.channels import EFFORT, NODAL_FORCE, TENSION
from cdrj_ros.report.table import (
    format_amount,
    format_angle,
    format_percent,
    format_r2,
    table_groups,
)

RELATIVE_GRADES: Final = ((0.02, "closely"), (0.05, "well"), (0.15, "roughly"))
"""Largest mean relative error for each word; the paper reports 4 % to 16 % for its channels."""

R2_GRADES: Final = ((0.98, "closely"), (0.94, "well"), (0.80, "roughly"))
"""Least R² for each word, for quantities that pass through zero."""

MOST_OF_A_KIND: Final = 4
"""Largest number of unfolded channels of one kind."""


@dataclass(frozen=True)
class KeyNumber:
    """One number shown in large type."""

    label: str
    """Subject of the number: "All 16 element tensions"."""
    value: str
    """The number with its unit: "0.52 %"."""
    meaning: str
    """Kind of the number: "mean relative error"."""
    detail: str
    """Additional figures: "0.18 N mean, 1.7 N largest"."""


@dataclass(frozen=True)
class Verdict:
    """The head of a report."""

    sentence: str
    """The summary."""
    detail: str
    """Location of the largest error, and the amount of compared data."""
    numbers: tuple[KeyNumber, ...]
    """The figures on which the sentence rests."""


def verdict(errors: Errors) -> Verdict:
    """Sum up the pooled figures of all recordings."""
    compared = {name: error for name, error in errors.pooled.items() if error.n > 0}
    if not compared:
        return Verdict(
            "Nothing could be compared: no reference in the recording has an estimate beside it.",
            "",
            (),
        )
    main = min((quantity_of(name) for name in compared), key=list(QUANTITIES).index)
    return Verdict(_sentence(main, compared), _detail(main, errors.bags, compared), _keys(compared))


def last_elements(names: Sequence[str]) -> tuple[str, ...]:
    """The tension channels of each cable's highest-numbered element, furthest from node 1."""
    last: dict[str, tuple[int, str]] = {}
    for name in names:
        cable, _, element = name.rpartition("/")
        if quantity_of(name) == TENSION and element.isdecimal():
            last[cable] = max(last.get(cable, (-1, "")), (int(element), name))
    return tuple(name for _, name in last.values())


def key_channels(names: Sequence[str]) -> tuple[str, ...]:
    """The most informative channels, in display order.

    The tension of a cable's last element contains the friction of all its pulleys.  The force at
    node 3 is the one measured in the paper; for a cable without it, the last node is chosen.  Its
    vector, where it is compared, and the efforts follow.  At most MOST_OF_A_KIND channels of each
    kind are chosen.
    """
    forces, vectors = (_key_nodes(names, quantity) for quantity in (NODAL_FORCE, FORCE_VECTOR))
    efforts = [name for name in names if quantity_of(name) in (EFFORT, ANGLE)]
    kinds = (last_elements(names), forces, vectors, efforts)
    chosen = tuple(name for kind in kinds for name in kind[:MOST_OF_A_KIND])
    return chosen or tuple(names[:MOST_OF_A_KIND])


def _key_nodes(names: Sequence[str], quantity: str) -> list[str]:
    """The channel of node 3 of each cable, or of its last node."""
    nodes: dict[str, tuple[tuple[bool, int], str]] = {}
    for name in names:
        cable, _, node = name.rpartition("/")
        if quantity_of(name) == quantity and node.isdecimal():
            rank = (int(node) == 3, int(node))
            nodes[cable] = max(nodes.get(cable, ((False, -1), "")), (rank, name))
    return [name for _, name in nodes.values()]


def direction_words(error: ChannelError) -> str:
    """Mean and largest direction error of a channel of vectors."""
    if error.mean_direction_error_deg is None:
        return "no direction"
    return (
        f"direction {format_angle(error.mean_direction_error_deg)} mean, "
        f"{format_angle(error.max_direction_error_deg)} largest"
    )


def _by_r2(quantity: str, error: ChannelError) -> bool:
    return QUANTITIES[quantity].signed or error.mean_relative_error is None


def _grade(quantity: str, error: ChannelError) -> str | None:
    if _by_r2(quantity, error):
        r2 = error.r2
        return next((word for least, word in R2_GRADES if r2 is not None and r2 >= least), None)
    relative = error.mean_relative_error
    return next(
        (word for most, word in RELATIVE_GRADES if relative is not None and relative <= most), None
    )


def _sentence(quantity: str, errors: Mapping[str, ChannelError]) -> str:
    members = _members(quantity, errors)
    overall = mean_over_channels(members.values())
    noun = QUANTITIES[quantity].title.lower()
    subject = f"The estimated {noun}" + ("s" if len(members) > 1 else "")
    follow = "follow" if len(members) > 1 else "follows"
    grade = _grade(quantity, overall)
    claim = (
        f"{subject} {follow} the recording {grade}"
        if grade
        else f"{subject} {'do' if len(members) > 1 else 'does'} not follow the recording"
    )
    mean_error = _amount(overall, overall.mean_abs_error, quantity)
    average = "on average " if len(members) > 1 else ""
    if _by_r2(quantity, overall):
        if overall.r2 is None:
            return (
                f"{claim}: {average}the mean error is {mean_error}, against a constant reference."
            )
        if overall.r2 <= 0.0:
            return f"{claim}: {average}the mean error is {mean_error}, R² {format_r2(overall.r2)}."
        return (
            f"{claim}: {average}{100.0 * overall.r2:.1f} % of its variation is explained, "
            f"the mean error is {mean_error}."
        )
    return (
        f"{claim}: {average}the error is {format_percent(overall.mean_relative_error)} "
        f"of the recorded value, {mean_error}."
    )


def _detail(
    quantity: str, comparisons: Sequence[BagComparison], errors: Mapping[str, ChannelError]
) -> str:
    members = _members(quantity, errors)
    worst_name, worst = max(members.items(), key=lambda item: item[1].max_abs_error or 0.0)
    title = QUANTITIES[quantity].title.lower()
    duration = sum(comparison.duration_s for comparison in comparisons)
    recordings = "one recording" if len(comparisons) == 1 else f"{len(comparisons)} recordings"
    channels = counted(len(errors), "channel")
    largest = _amount(worst, worst.max_abs_error, quantity)
    return (
        f"The largest {title} error of any sample is {largest}, in {worst_name}"
        f"{_moment(worst_name, comparisons)}. Compared: {channels} over "
        f"{duration:.0f} s in {recordings}."
    )


def _moment(name: str, comparisons: Sequence[BagComparison]) -> str:
    """Time of the channel's largest error, and its recording if there are several."""
    worst, where = -1.0, ""
    for comparison in comparisons:
        origin_ns = origin_of(comparison)
        for channel in comparison.channels:
            if channel.name != name or len(channel.stamp_ns) == 0:
                continue
            size = channel.error_size
            at = int(size.argmax())
            if size[at] > worst:
                worst = float(size[at])
                second = float(channel.stamp_ns[at] - origin_ns) * 1e-9
                where = f" at {second:.1f} s"
                if len(comparisons) > 1:
                    where += f" of {comparison.path}"
    return where


def origin_of(comparison: BagComparison) -> int:
    """Stamp at 0 s of a recording's pictures [ns]: its first compared sample."""
    return min((int(c.stamp_ns[0]) for c in comparison.channels if len(c.stamp_ns)), default=0)


def _keys(errors: Mapping[str, ChannelError]) -> tuple[KeyNumber, ...]:
    groups = table_groups(errors)
    if len(groups) == 1 and len(errors) <= MOST_OF_A_KIND:
        return tuple(_key(groups[0].quantity, name, {name: e}) for name, e in errors.items())
    numbers = []
    tensions = _members(TENSION, errors)
    last = {name: errors[name] for name in last_elements(list(tensions))}
    if last and len(last) < len(tensions):
        label = (
            "Last element of each cable" if len(last) > 1 else f"Last element, {next(iter(last))}"
        )
        numbers.append(_key(TENSION, label, last))
    for group in groups:
        members = _members(group.quantity, errors)
        numbers.append(_key(group.quantity, _counted_label(group.quantity, len(members)), members))
    return tuple(numbers)


def _counted_label(quantity: str, n: int) -> str:
    """All channels of a quantity: "Tension", "Both efforts", "All 16 element tensions"."""
    known = QUANTITIES[quantity]
    if n == 1:
        return known.title
    return f"Both {known.several}" if n == 2 and known.signed else f"All {n} {known.several}"


def _key(quantity: str, label: str, members: Mapping[str, ChannelError]) -> KeyNumber:
    overall = mean_over_channels(members.values())
    detail = (
        f"{_amount(overall, overall.mean_abs_error, quantity)} mean, "
        f"{_amount(overall, overall.max_abs_error, quantity)} largest"
    )
    if quantity == FORCE_VECTOR:
        detail += f"; {direction_words(overall)}"
    if _by_r2(quantity, overall):
        known = {name: e.r2 for name, e in members.items() if e.r2 is not None}
        if not known:
            return KeyNumber(
                label, _amount(overall, overall.mean_abs_error, quantity), "mean error", detail
            )
        lowest = min(known, key=lambda name: known[name])
        meaning = f"R², lowest: {lowest.partition('/')[2]}" if len(members) > 1 else "R²"
        return KeyNumber(label, format_r2(known[lowest]), meaning, detail)
    relative = format_percent(overall.mean_relative_error)
    return KeyNumber(label, relative, "mean relative error", detail)


def _members(quantity: str, errors: Mapping[str, ChannelError]) -> dict[str, ChannelError]:
    return {name: error for name, error in errors.items() if quantity_of(name) == quantity}


def _amount(error: ChannelError, value: float | None, quantity: str) -> str:
    return format_amount(value, error.unit or QUANTITIES[quantity].unit)


def health_of(bag: BagComparison) -> list[str]:
    """The verdict in lines that name the recording; none if the monitor did not run."""
    lines = health_lines(bag.health) if bag.health else []
    return [f"health: {bag.path}: {line}" for line in lines]


def health_lines(verdict: HealthVerdict) -> list[str]:
    """The verdict first, then one line for every alarm."""
    sensors = ", ".join(verdict.sensors)
    compared = f"{counted(verdict.cycles, 'cycle')} compared by {sensors}"
    if not verdict.alarms:
        return [f"{verdict.message} ({compared})"]
    return [f"alarm ({compared})", *(_line(one) for one in verdict.alarms)]


def _line(alarm: Alarm) -> str:
    if alarm.first_cycle == alarm.last_cycle:
        cycles = f"cycle {alarm.first_cycle}"
    else:
        cycles = f"cycles {alarm.first_cycle} to {alarm.last_cycle}"
    span = f"{alarm.begin_s:.1f} to {alarm.end_s:.1f} s"
    return f"{alarm.level}, {cycles}, {span}: {alarm.message}"
