"""Output of ``check_robot`` on the uncertainty of the tensions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cdrj_ros.inspection.shares import Cause, Shares
from cdrj_ros.model.prepared import Model

if TYPE_CHECKING:
    from rich.console import Console

LEAST_SHARE: Final = 0.01
"""A cause with a smaller share in every element is not listed."""

NAMED: Final = 3
"""Number of causes for which the measurement is printed."""


def print_shares(model: Model, shares: Shares, console: Console) -> None:
    """Print a table per cable, and the measurements that would help most."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    known = model.robot.uncertainty
    assumed = known is not None and len(known.parameters) > known.stated
    told: list[Cause] = []
    begin = 0
    for cable in model.robot.cables:
        part = slice(begin, begin + len(cable.element_names))
        begin = part.stop
        table = Table(
            title=f"{cable.name}: shares in the variance of the tensions [%]",
            title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False,
        )  # fmt: skip
        table.add_column("")
        for k in range(len(cable.element_names)):
            table.add_column(str(k + 1), justify="right", no_wrap=True)
        for cause in shares.causes:
            if np.abs(cause.share[part]).max() >= LEAST_SHARE:
                table.add_row(Text(cause.what), *(f"{100 * one:.0f}" for one in cause.share[part]))
                told += [] if cause in told else [cause]
        table.add_section()
        table.add_row("σ [N]", *(f"{one:.3g}" for one in shares.stddev[part]), style="bold")
        console.print()
        console.print(table)
    source = "the defaults of docs/uncertainty.md" if assumed else "the file"
    named = [cause for cause in shares.causes if cause in told][:NAMED]
    console.print(Text(f"These numbers make most of the uncertainty, by {source}; to halve it:"))
    for cause in named:
        console.print(Text(f"  {cause.what}: {cause.measure}"))


def shares_document(model: Model, shares: Shares | None) -> dict[str, Any] | None:
    """All shares as plain values for JSON, without omissions."""
    if shares is None:
        return None
    names = model.layout.elements
    return {
        "stddev": dict(zip(names, shares.stddev.tolist(), strict=True)),
        "causes": [
            {
                "what": cause.what,
                "measure": cause.measure,
                "share": dict(zip(names, cause.share.tolist(), strict=True)),
            }
            for cause in shares.causes
        ],
    }
