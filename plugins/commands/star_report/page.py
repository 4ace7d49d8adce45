"""The page of a flight: one HTML file that makes no request to a network."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any

from plotly.io.json import to_json_plotly

from star_core import Run
from star_core.toolkit import number_at
from star_report import charts, views
from star_report.figures import Figure
from star_report.images import images
from star_report.labels import file_name, made
from star_report.sheet import footer, sheet


def page(run: Run) -> str:
    """Return the report of a run as HTML."""
    summary = run.summary
    sections = [_header(run), _figures_of_merit(summary)]
    drawn: list[tuple[str, str, Figure]] = [
        (
            "Top view",
            "Solid: ground truth (the estimate, if there is none). Dotted: estimate. "
            "Circle: start; square: end.",
            views.top_view(run),
        ),
        ("Replay", "Solid: the last 10 s. Dashed: planned path.", views.replay(run)),
        *charts.series(run),
        ("Steps", "When each agent executed which step.", charts.steps(run)),
        *charts.tick_times(run),
        ("Computing time", "In total, by plugin.", charts.compute(run)),
    ]
    sections += [section(i, *drawn[i]) for i in range(len(drawn))]
    sections += [*images(run), _events(summary["events"]), _made(run)]
    return render(f"{summary['mission']}: {summary['outcome']}", sections)


def render(title: str, sections: Sequence[str]) -> str:
    """Return a page with sections of HTML and, in them, figures."""
    scripts = (files("star_report") / "figures.html").read_text(encoding="utf-8")
    return sheet(title, sections, scripts.replace("{{plotly}}", _plotly()))


def _plotly() -> str:
    """Return Plotly's script, compressed, as base64: a browser decompresses it by itself."""
    script = (files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    return base64.b64encode(gzip.compress(script, 9, mtime=0)).decode()


def _header(run: Run) -> str:
    summary = run.summary
    outcome = escape(summary["outcome"])
    reason = f"<p>{escape(summary['reason'])}</p>" if summary["reason"] else ""
    plugins = ", ".join(
        f"{kind} {plugin['name']}" for kind, plugin in run.manifest["plugins"].items()
    )
    return (
        f'<h1>{escape(summary["mission"])} <span class="{outcome}">{outcome}</span></h1>{reason}'
        f"<p class=quiet>{escape(run.manifest['mission_file'])} · seed {summary['seed']} · "
        f"{escape(plugins)}</p>"
    )


def _figures_of_merit(summary: Mapping[str, Any]) -> str:
    contacts = summary["collisions"]
    by = "" if summary["distances_from"] == "ground_truth" else " (estimated positions)"
    targets = summary["targets"]
    rows = [
        ("flight time", f"{summary['flight_time_s']:.1f} s"),
        ("agents", str(len(summary["agents"]))),
        ("collisions between agents", f"{contacts['agent_agent']}{by}"),
        ("collisions with obstacles", f"{contacts['agent_obstacle']}{by}"),
        ("closest approach", _metres(summary["min_separation_m"])),
        ("least clearance", _metres(summary["min_clearance_m"])),
        ("position error (RMS)", _metres(number_at(summary, "position_rmse_m"), 3)),
        ("largest position error", _metres(number_at(summary, "position_worst_m"), 3)),
        ("distance flown", _metres(number_at(summary, "path_length_m.total"), 1)),
        ("targets found", f"{targets['found']} of {targets['total']}" if targets["total"] else ""),
        ("late ticks", str(summary["late_ticks"]) if summary["late_ticks"] else ""),
    ]
    cells = "".join(
        f"<div><dt>{label}</dt><dd>{escape(text)}</dd></div>" for label, text in rows if text
    )
    return f"<dl class=figures>{cells}</dl>"


def _made(run: Run) -> str:
    manifest, seed = run.manifest, run.summary["seed"]
    others = manifest.get("third_parties")
    plugins = (
        ", ".join(f"{k} {v}" for k, v in others.items()) if isinstance(others, Mapping) else ""
    )
    rows = {
        "mission": str(manifest["mission_file"]),
        "seed": str(seed),
        "third-party plugins": plugins,
        "record": str(run.folder),
    }
    return footer(made(manifest, rows))


def section(number: int, title: str, caption: str, figure: Figure) -> str:
    """Return a section with the figure of a number: the replay with controls, others to save."""
    # `</` would end the script element
    data = to_json_plotly(figure).replace("</", "<\\/")
    save = controls = ""
    if "path" in figure:
        controls = (
            "<p class=controls><button id=play>▶ Play</button> <input id=frame type=range min=0 "
            "value=0 aria-label=time> <span id=clock></span> <select id=speed aria-label=speed>"
            "<option value=1>1x<option value=4 selected>4x<option value=16>16x</select></p>"
        )
    else:
        save = (
            f'<button class=save id=save{number} data-name="{file_name(title)}" '
            'title="Save this figure as SVG">SVG</button>'
        )
    height = figure["layout"]["height"]
    return (
        f"<section><h2>{escape(title)}{save}</h2><p class=quiet>{escape(caption)}</p>"
        f'<div class=figure id=figure{number} style="height:{height}px"></div>{controls}'
        f"<script type=application/json data-figure={number}>{data}</script></section>"
    )


def _events(events: Sequence[Mapping[str, Any]]) -> str:
    rows = "".join(
        f'<tr class="{escape(event["kind"])}"><td>{event["time"]:.2f} s<td>{escape(event["kind"])}'
        f"<td>{escape(str(event.get('agent', '')))}<td>{escape(event['text'])}"
        for event in events
    )
    return (
        "<section class=long><h2>Events</h2><div class=events><table><tr><th>time<th>kind<th>agent"
        "<th>event"
        f"{rows}</table></div></section>"
    )


def _metres(value: float | None, digits: int = 2) -> str:
    return "" if value is None else f"{value:.{digits}f} m"
