"""Write the layouts in config/layouts, or those of another robot.

    python tools/layouts.py                          # config/layouts, of the prototype
    python tools/layouts.py --robot R.yaml --out DIR

Names of elements and axes are the robot's, so a layout fits one robot. PlotJuggler and Foxglove
show an array by index: `tension[k]` is the k-th element, in the order of the robot file. The
curves by name in PlotJuggler are those of the topic tension_states.
"""

import argparse
import json
from pathlib import Path
from xml.etree import ElementTree

from cdrj_ros.foundation.files import write_text
from cdrj_ros.model.prepared import load_model

TENSIONS, FORCES = "/cdrj/tensions", "/cdrj/nodal_forces"
EFFORTS, DIAGNOSTICS = "/cdrj/efforts", "/diagnostics"
STATES = "/cdrj/tension_states"

COLOURS = (
    "#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf", "#bcbd22", "#8c564b",
    "#e377c2", "#7f7f7f",
)  # fmt: skip
"""Colours of curves, used in turn."""


def _numbers(names, cable):
    """Indices in a message and names of the entries that belong to a cable."""
    return [(k, name) for k, name in enumerate(names) if name.rpartition("/")[0] == cable]


# --- PlotJuggler: what MainWindow, PlotDocker and PlotWidget load from XML ------------------------


def _plot(curves):
    plot = ElementTree.Element("plot", mode="TimeSeries", style="Lines")
    ElementTree.SubElement(plot, "limitY")
    for k, name in enumerate(curves):
        ElementTree.SubElement(plot, "curve", name=name, color=COLOURS[k % len(COLOURS)])
    return plot


def _tab(name, areas):
    """A tab of plots, one below the other."""
    tab = ElementTree.Element("Tab", tab_name=name, containers="1")
    share = ";".join([f"{1.0 / len(areas):.6f}"] * len(areas))
    splitter = ElementTree.SubElement(
        ElementTree.SubElement(tab, "Container"),
        "DockSplitter", orientation="-", count=str(len(areas)), sizes=share,
    )  # fmt: skip
    for title, curves in areas:
        ElementTree.SubElement(splitter, "DockArea", name=title).append(_plot(curves))
    return tab


def plotjuggler(layout):
    """Return the layout as XML."""
    root = ElementTree.Element("root")
    window = ElementTree.SubElement(root, "tabbed_widget", parent="main_window", name="Main Window")
    for tab, topic, field, names in (
        ("tensions", TENSIONS, "tension", layout.elements),
        ("standard deviations", TENSIONS, "stddev", layout.elements),
        ("status", TENSIONS, "status", layout.elements),
        ("nodal forces", FORCES, "magnitude", layout.pulleys),
        ("friction", FORCES, "friction", layout.pulleys),
    ):
        areas = []
        for cable in layout.cables:
            places = _numbers(names, cable)
            if places:
                (first, begin), (last, end) = places[0], places[-1]
                title = f"{begin} to {end}: {field}[{first}] to {field}[{last}]"
                areas.append((title, [f"{topic}/{field}[{k}]" for k, _ in places]))
        window.append(_tab(tab, areas))
    axes = [f"{EFFORTS}/{name}/effort" for name in (*layout.motors, *layout.joints)]
    window.append(_tab("efforts", [("motors and joints [N m]", axes)]))
    by_name = [
        (cable, [f"{STATES}/{name}/effort" for _, name in _numbers(layout.elements, cable)])
        for cable in layout.cables
    ]
    window.append(_tab("tensions by name", by_name))
    ElementTree.SubElement(window, "currentTabIndex", index="0")
    ElementTree.SubElement(root, "use_relative_time_offset", enabled="1")
    ElementTree.SubElement(root, "streaming_buffer_size", value="30")
    streamer = "ROS2 Topic Subscriber"
    plugins = ElementTree.SubElement(root, "Plugins")
    plugin = ElementTree.SubElement(plugins, "plugin", ID=streamer)
    for setting, value in (
        ("use_header_stamp", "false"),
        ("discard_large_arrays", "true"),
        ("max_array_size", "1000"),
        ("boolean_strings_to_number", "false"),
        ("remove_suffix_from_strings", "false"),
        ("selected_topics", f"{TENSIONS};{FORCES};{EFFORTS};{STATES}"),
    ):
        ElementTree.SubElement(plugin, setting, value=value)
    ElementTree.SubElement(root, "previouslyLoaded_Streamer", name=streamer)
    ElementTree.indent(root, " ")
    text = ElementTree.tostring(root, encoding="unicode")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{text}\n"


# --- Foxglove and Lichtblick: panels by id, and a tree of splits ----------------------------------


def _panel(title, paths):
    """A plot panel; Foxglove and Lichtblick use different keys for the title."""
    return {
        "foxglovePanelTitle": title,
        "lichtblickPanelTitle": title,
        "paths": [
            {
                "value": path,
                "label": label,
                "enabled": True,
                "timestampMethod": "receiveTime",
                "color": COLOURS[k % len(COLOURS)],
            }
            for k, (path, label) in enumerate(paths)
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": False,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
        "followingViewWidth": 30,
    }


def _stacked(ids, direction):
    """A tree of splits with panels of equal size."""
    if len(ids) == 1:
        return ids[0]
    return {
        "direction": direction,
        "first": ids[0],
        "second": _stacked(ids[1:], direction),
        "splitPercentage": 100.0 / len(ids),
    }


def foxglove(layout):
    """Return the layout as JSON."""
    panels, left, right = {}, [], []

    def add(column, name, title, paths):
        panels[f"Plot!{name}"] = _panel(title, paths)
        column.append(f"Plot!{name}")

    for number, cable in enumerate(layout.cables):
        elements = _numbers(layout.elements, cable)
        add(
            left, f"tension{number}", f"{cable}: tension [N]",
            [(f"{TENSIONS}.tension[{k}]", name) for k, name in elements],
        )  # fmt: skip
        add(
            right, f"stddev{number}", f"{cable}: standard deviation [N]",
            [(f"{TENSIONS}.stddev[{k}]", name) for k, name in elements],
        )  # fmt: skip
    axes = (*layout.motors, *layout.joints)
    add(
        left, "effort", "effort [N m]",
        [(f"{EFFORTS}.effort[{k}]", name) for k, name in enumerate(axes)],
    )  # fmt: skip
    diagnostics = "DiagnosticStatusPanel!estimator"
    panels[diagnostics] = {
        "topicToRender": DIAGNOSTICS,
        "collapsedSections": [],
        "selectedHardwareId": "",
    }
    right.append(diagnostics)
    document = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": _stacked(left, "column"),
            "second": _stacked(right, "column"),
            "splitPercentage": 60,
        },
    }
    return json.dumps(document, indent=2) + "\n"


def main():
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robot", default="prototype", help="file or name (default %(default)s)")
    folder = Path(__file__).resolve().parents[1] / "config" / "layouts"
    parser.add_argument("--out", type=Path, default=folder, help="folder (default config/layouts)")
    arguments = parser.parse_args()
    model = load_model(arguments.robot)
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name, text in (
        (f"plotjuggler_{model.robot.name}.xml", plotjuggler(model.layout)),
        (f"foxglove_{model.robot.name}.json", foxglove(model.layout)),
    ):
        write_text(arguments.out / name, text)
        print(arguments.out / name)


if __name__ == "__main__":
    main()
