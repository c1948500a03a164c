"""The command line of ``identify``."""

from __future__ import annotations

import argparse

from cdrj_ros.commands.running import CommandParser
from cdrj_ros.commands.shared import add_topic_options
from cdrj_ros.identification.observations import WEIGHTS
from cdrj_ros.identification.problem import LOSSES


def parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = CommandParser(
        prog="identify",
        description="Identify parameters of the robot file from bags, with standard errors and "
        "the errors on held-out bags.",
        epilog="Parameters are paths of the robot file in SI, such as cables.upper.preload, "
        "friction.rho, cables.b.nodes.3.bearing_torque, or short forms: rho, mu_c, mu_s, v_s, "
        "f_d, EA, preload, drum_radius, joint_offset, joint_scale, clock_offset. "
        "docs/identification.md",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    parser.add_argument("--robot", metavar="FILE", help="robot file to start from")
    parser.add_argument(
        "--fit", metavar="NAME,...",
        help="parameters to identify; 'cables.*.preload': one value for all cables, "
        "'cables.{*}.preload': one for each, 'a=b' and 'a=-b': two tied parameters",
    )  # fmt: skip
    parser.add_argument(
        "--free", default="", metavar="NAME,...",
        help="fitted parameters of which nothing is known: otherwise each keeps its value in the "
        "file with the default standard deviation as a prior, unless the file states one",
    )  # fmt: skip
    parser.add_argument(
        "--only", action="store_true",
        help="fit these alone; otherwise stiffness, preload, drum radius, zeros and drag are "
        "fitted along where the file states no accuracy, with the default tolerance as prior",
    )  # fmt: skip
    parser.add_argument(
        "--from", dest="source", metavar="FILE", help="identified robot file of another pose"
    )
    parser.add_argument(
        "--pose", action="store_true",
        help="with --from: fit only what another pose changes: zeros, rests of springs, preloads, "
        "and wraps and drag of the pulleys",
    )  # fmt: skip
    parser.add_argument("--out", metavar="FILE", help="robot file to write; comments are kept")
    parser.add_argument(
        "--force",
        action="store_true",
        help="replace an existing --out, also the file given by --robot",
    )
    parser.add_argument(
        "--json", metavar="FILE", help="write the figures as JSON, replacing the file"
    )
    _add_number_options(parser)
    _add_fit_options(parser)
    _add_bag_options(parser)
    _add_machine_option(parser)
    add_topic_options(parser)
    return parser


def _add_number_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("numbers")
    for option, form, text in (
        ("--start", "NAME=VALUE", "starting value, or the value of a number that is not fitted"),
        ("--bounds", "NAME=LOW:HIGH", "bounds of a number; either may be omitted"),
        ("--prior", "NAME=MEAN:STDDEV", "prior knowledge of a number"),
    ):
        group.add_argument(
            option, action="append", default=[], metavar=form, help=f"{text}; SI, repeatable"
        )


def _add_fit_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("fit")
    group.add_argument(
        "--channels", default="", metavar="NAME,...",
        help="references to fit, wildcards allowed: 'tension/*/8,nodal_force/upper/3' (all)",
    )  # fmt: skip
    group.add_argument(
        "--weights", choices=WEIGHTS, default="spread",
        help="divide residuals by the standard deviation of the references of their kind, or by "
        "their sensor's noise (%(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--sigma", action="append", default=[], metavar="NAME=VALUE",
        help="divide the residuals of a reference by VALUE [N] or [N m]; repeatable",
    )  # fmt: skip
    group.add_argument(
        "--loss", choices=LOSSES, default="linear", help="loss function (%(default)s)"
    )
    group.add_argument("--starts", type=int, default=1, metavar="N", help="number of starts (1)")
    group.add_argument("--seed", type=int, default=0, help="seed of the random starts (0)")
    group.add_argument(
        "--settle", type=float, default=0.0, metavar="S",
        help="exclude the first S seconds of every bag, in which the friction state is unknown (0)",
    )  # fmt: skip
    group.add_argument(
        "--quick", action="store_true",
        help="use only samples thinned to about 100 Hz; omit the last round with all samples",
    )  # fmt: skip


def _add_bag_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("other bags")
    group.add_argument(
        "--hold-out", action="append", nargs="+", default=[], metavar="BAG",
        help="bags that are not fitted, on which the result is evaluated",
    )  # fmt: skip
    group.add_argument(
        "--cross-validate", nargs="*", metavar="NAMES",
        help="fit again without each bag, or without matching bags, and evaluate these bags",
    )  # fmt: skip


def _add_machine_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scheduler", metavar="ADDRESS",
        help="compute residuals on the Dask cluster with this scheduler, such as "
        "tcp://10.0.0.5:8786; otherwise on all processors of this machine "
        "(docs/recordings.md)",
    )  # fmt: skip
