"""Charts of a flight: over time, by step and by plugin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Final

import numpy as np

from star_core import Run
from star_report.figures import MAX_POINTS, Figure, colour, crosses, dotted, line, over_time
from star_report.series import Nearest, clearance, errors, peaks, positions, separation

MIN_TICKS: Final = 2  # for which tick times are shown
CONTACT: Final = 0.12  # m between the centres of two agents that touch
APPROACHES: Final = ("collision", "close_approach")  # kinds of events
STAGES: Final = {
    "tick": "whole tick",
    "localizer": "localizer",
    "planner": "planner",
    "avoider": "avoider",
    "safety": "safety filter",
}
"""Lines of the figure of computing time, by the array of `Run.timing`."""


def series(run: Run) -> Iterator[tuple[str, str, Figure]]:
    """Yield title, caption and figure of what is plotted over time."""
    time = run.arrays["time"]
    if (bounded_error := errors(run)) is not None:
        error, bound = bounded_error
        lines = []
        for i, name in enumerate(run.agents):
            lines += [
                line(time, error[:, i], name, colour(i), group=name),
                dotted(line(time, bound[:, i], f"{name}, 3 std", colour(i), group=name)),
            ]
        yield (
            "Position error",
            "Distance between estimate and ground truth in the air. Dotted: three standard "
            "deviations by the estimate's covariance. The figures at the top leave out take-offs "
            "and landings.",
            over_time(lines, "error (m)"),
        )
    if (figure := _distances(run, "separation", separation(run), CONTACT)) is not None:
        caption = "Distance between the two nearest agents in the air. Dashed: contact."
        yield "Separation", caption, figure
    if (figure := _distances(run, "clearance", clearance(run), obstacles=True)) is not None:
        yield "Clearance", "Distance from the nearest obstacle to an agent in the air.", figure
    altitude, battery = positions(run)[..., 2], run.arrays["battery"]
    for title, caption, array, axis, mode in (
        ("Altitude", "z of each agent in the map.", altitude, "z (m)", "tozero"),
        ("Battery", "Battery voltage of each agent.", battery, "voltage (V)", "normal"),
    ):
        if np.isfinite(array).any():
            lines = [line(time, array[:, i], n, colour(i)) for i, n in enumerate(run.agents)]
            figure = over_time(lines, axis)
            figure["layout"]["yaxis"]["rangemode"] = mode
            yield title, caption, figure


def tick_times(run: Run) -> Iterator[tuple[str, str, Figure]]:
    """Yield the figure of each tick's computing time, if that is recorded."""
    if len(run.timing.get("time", ())) < MIN_TICKS:
        return
    lines = [
        line(*peaks(run.timing["time"], 1000 * run.timing[key], MAX_POINTS), name, colour(i))
        for i, (key, name) in enumerate(STAGES.items())
    ]
    late = 1000 * run.timing["late"]
    if late.any():
        lines.append(line(*peaks(run.timing["time"], late, MAX_POINTS), "lateness", colour(6)))
    period = 1000 * float(np.median(np.diff(run.arrays["time"])))
    figure = over_time(lines, "time (ms)", period)
    figure["layout"]["yaxis"] |= {"type": "log", "dtick": 1, "rangemode": "normal"}
    yield (
        "Tick times",
        "Computing time of every tick, logarithmic; the first ticks load packages and kernels. "
        f"Dashed: from one tick to the next, {period:g} ms.",
        figure,
    )


def steps(run: Run) -> Figure:
    """Return when each agent executed which step."""
    verbs = list(dict.fromkeys(step["verb"] for step in run.summary["steps"]))
    end = float(run.arrays["time"][-1])
    data = []
    for k, verb in enumerate(verbs):
        bars = [
            (agent, step["begun_s"], step["ended_s"] if step["ended_s"] is not None else end, step)
            for step in run.summary["steps"]
            if step["verb"] == verb
            for agent in step["agents"]
        ]
        data.append(
            {
                "type": "bar",
                "orientation": "h",
                "name": escape(verb),
                "y": [bar[0] for bar in bars],
                "base": [bar[1] for bar in bars],
                "x": [bar[2] - bar[1] for bar in bars],
                "text": [escape(bar[3].get("location", "")) for bar in bars],
                "hovertemplate": f"%{{y}}: {escape(verb)}<br>%{{text}}<br>%{{base:.2f}} s"
                "<extra></extra>",
                "textposition": "none",
                "marker": {"color": colour(k)},
            }
        )
    return {
        "data": data,
        "layout": {
            "barmode": "overlay",
            "xaxis": {"title": {"text": "mission time (s)"}},
            "yaxis": {"autorange": "reversed", "type": "category"},
            "height": 130 + 28 * len(run.agents),
        },
    }


def compute(run: Run) -> Figure:
    """Return the computing time of each plugin."""
    spent: Mapping[str, float] = run.summary["compute_s"]
    names = sorted(spent, key=lambda name: spent[name])
    return {
        "data": [
            {
                "type": "bar",
                "orientation": "h",
                "y": [escape(name.partition(" (")[0]) for name in names],
                "x": [spent[name] for name in names],
                "marker": {"color": colour(0)},
                "hovertemplate": "%{y}: %{x:.3f} s<extra></extra>",
            }
        ],
        "layout": {
            "xaxis": {"title": {"text": "computing time (s)"}},
            "yaxis": {"automargin": True},
            "height": 120 + 22 * len(names),
        },
    }


def _distances(
    run: Run,
    name: str,
    nearest: Nearest,
    level: float | None = None,
    *,
    obstacles: bool = False,
) -> Figure | None:
    """Return distances over time; crosses are the least one, collisions and close approaches.

    Args:
        run: The flight.
        name: Of the line.
        nearest: Distances over time; None is returned if there are none.
        level: Of a dashed line, m.
        obstacles: Whether collisions are those with obstacles, or between agents.
    """
    if nearest.tick is None:
        return None
    time = run.arrays["time"]
    approaches = [(float(time[nearest.tick]), nearest.least, nearest.text)]
    for event in run.summary["events"]:
        details = event.get("details") or {}
        if event["kind"] in APPROACHES and ("obstacle" in details) == obstacles:
            moment = details.get("time_s", event["time"])
            at = int(np.searchsorted(time, moment))
            distance = float(nearest.distance[min(at, len(nearest.distance) - 1)])
            if np.isfinite(distance):
                approaches.append((moment, distance, escape(event["text"])))
    lines = [
        line(time, nearest.distance, name, colour(0)),
        crosses(approaches, "closest approaches"),
    ]
    return over_time(lines, "distance (m)", level)
