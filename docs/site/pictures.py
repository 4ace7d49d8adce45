"""Makes the pictures of README and documentation: `make pictures`, or some of them by their names.

Flights are simulated anew. Plots are those of `star report`, saved as SVG by its page in headless
Chromium; the pages of `star view` are photographed there, and the moving picture is a WebP of them.

    python docs/site/pictures.py [NAME...]
"""

from __future__ import annotations

import io
import math
import shutil
import sys
import tempfile
import time
from base64 import b64decode
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import unquote

from PIL import Image

from star_core import Registry, Run, fly, load, read_run
from star_report.page import render, section
from star_report.views import top_view
from star_view.replay import Replay

ROOT: Final = Path(__file__).parents[2]
PICTURES: Final = ROOT / "docs" / "pictures"
MISSIONS: Final = ROOT / "missions"
sys.path.insert(0, str(ROOT))  # the tests have a browser
from tests.plugins.commands.star_view.chromium import Chromium  # noqa: E402 -- on this path

GL: Final = ("--enable-unsafe-swiftshader", "--use-gl=angle", "--use-angle=swiftshader")
PAGE: Final = (1400, 875)  # px, of `star view`
PANEL: Final = 400  # px, of its right side
MOVIE: Final = (800, 500)  # px, of the moving picture
PLAYED: Final = 6  # frames per second of the moving picture
SPEED: Final = 3.0  # of the moving picture, over real time
QUALITY: Final = 60  # %, of its frames
SETTLE: Final = 0.35  # s, in which a page draws a frame
LOAD: Final = 8.0  # s, in which a page loads its scene or its camera images
WIDE: Final = 900  # px, of a plot
CLOSE: Final = "document.querySelector('.mantine-Notification-closeButton')?.click()"

CIRCLE: Final = """\
star: 1
name: circle
world: lab_4x4.yaml
limits: {{speed: 0.5, uncertainty_margin: 0}}
collisions: record
swarm:
{swarm}
transport: {{use: sim, profile: ideal, controller: ideal, noise: false}}
localizer: flow
planner: straight
avoider: {{use: {avoider}}}
mission:
  - takeoff: {{height: 0.8}}
  - parallel:
{goals}
  - land: {{}}
"""


class Panel(NamedTuple):
    """A plot beside others.

    Attributes:
        title: Above it.
        run: The flight from above.
    """

    title: str
    run: Run


@contextmanager
def flights() -> Iterator[Callable[..., Run]]:
    """Yield a function that flies a mission with changes as of ``--set``, and returns its record.

    The records are deleted at the end.
    """
    registry = Registry()
    with tempfile.TemporaryDirectory() as home:

        def flown(path: Path, *changes: str, images: bool = False) -> Run:
            folder = Path(tempfile.mkdtemp(dir=home)) / "run"
            fly(load(path, registry, changes), registry, folder=folder, save_frames=images)
            return read_run(folder)

        yield flown


def movie(flown: Callable[..., Run]) -> None:
    """Three drones search a hall, on the page of `star view`, without its panel."""
    run = flown(MISSIONS / "search.yaml")
    end = float(run.arrays["time"][-1])
    moments = [SPEED / PLAYED * k for k in range(int(end * PLAYED / SPEED) + 1)]
    images = [
        Image.open(io.BytesIO(shot)).convert("RGB")
        for shot in _shots(run, moments, (MOVIE[0] + PANEL, MOVIE[1]), MOVIE)
    ]
    durations = [1000 // PLAYED] * (len(images) - 1) + [2000]
    images[0].save(
        PICTURES / "view.webp", save_all=True, append_images=images[1:], duration=durations,
        loop=0, quality=QUALITY, method=6,
    )  # fmt: skip


def pages(flown: Callable[..., Run]) -> None:
    """Write pages of `star view` with their panels: cameras and tags, obstacles and plans."""
    for name, mission, moment, images in (
        ("view_cameras", "three_eyes", 11.0, True),
        ("view_obstacles", "around", 8.0, False),
    ):
        run = flown(MISSIONS / f"{mission}.yaml", images=images)
        [shot] = _shots(run, [moment], PAGE, PAGE)
        Image.open(io.BytesIO(shot)).convert("P", palette=Image.Palette.ADAPTIVE).save(
            PICTURES / f"{name}.png", optimize=True
        )


def paper(flown: Callable[..., Run]) -> None:
    """The paper's three paths, located by tags."""
    runs = {name: flown(MISSIONS / f"paper_{name}.yaml") for name in ("box", "circle", "figure8")}
    _save("paper", [Panel(f"{name}: {_error(run)}", run) for name, run in runs.items()])


def localizers(flown: Callable[..., Run]) -> None:
    """One path by each localizer."""
    runs = {
        "flow": flown(MISSIONS / "paper_box.yaml", "localizer=flow"),
        "apriltag": flown(MISSIONS / "paper_box.yaml"),
        "mocap": flown(
            MISSIONS / "paper_box.yaml", "localizer=mocap",
            "transport={use: sim, positioning: {std: 0.03}}",
        ),
        "onboard": flown(
            MISSIONS / "paper_box.yaml", "world=worlds/lighthouse_4x4.yaml",
            "localizer={use: onboard, system: lighthouse}",
            "transport={use: sim, onboard: {system: lighthouse}}",
        ),
    }  # fmt: skip
    _save("localizers", [Panel(f"{name}: {_error(run)}", run) for name, run in runs.items()])


def planners(flown: Callable[..., Run]) -> None:
    """Each planner among obstacles, at which the avoider stops what `straight` plans."""
    path = MISSIONS / "around.yaml"
    plans = {name: flown(path, f"planner={name}") for name in ("straight", "visibility")}
    _save("planners", [Panel(f"{n}: {r.summary['outcome']}", r) for n, r in plans.items()])


def avoiders(flown: Callable[..., Run]) -> None:
    """Six drones on a circle swap sides through its center, by each avoider."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(MISSIONS / "worlds" / "lab_4x4.yaml", folder)
        panels = []
        for avoider in ("none", "orca", "voronoi", "potential"):
            path = Path(folder) / f"{avoider}.yaml"
            path.write_text(_circle(avoider), encoding="utf-8")
            run = flown(path)
            swapped = all(step["outcome"] == "success" for step in run.summary["steps"])
            took, least = _took(run) if swapped else "stuck", run.summary["min_separation_m"]
            panels.append(Panel(f"{avoider}<br>{took}, ≥ {least:.2f} m apart", run))
    _save("avoiders", panels)


def searches(flown: Callable[..., Run]) -> None:
    """One search by each pattern."""
    text = (MISSIONS / "search.yaml").read_text(encoding="utf-8")
    panels = []
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(MISSIONS / "worlds", Path(folder) / "worlds")
        for pattern in ("sweep", "frontier"):
            path = Path(folder) / f"{pattern}.yaml"
            path.write_text(text.replace("pattern: sweep", f"pattern: {pattern}"), "utf-8")
            run = flown(path)
            panels.append(Panel(f"{pattern}: {_took(run)}", run))
    _save("searches", panels)


def _circle(avoider: str) -> str:
    ring = [(1.2 * math.cos(k * math.pi / 3), 1.2 * math.sin(k * math.pi / 3)) for k in range(6)]
    swarm = [f"  cf{k + 1}: {{start: [{x:.2f}, {y:.2f}, 0]}}" for k, (x, y) in enumerate(ring)]
    goals = [
        f"      - goto: {{agents: cf{k + 1}, to: [{-x:.2f}, {-y:.2f}, 0.8], timeout: 30, "
        "on_failure: continue}"
        for k, (x, y) in enumerate(ring)
    ]
    return CIRCLE.format(swarm="\n".join(swarm), goals="\n".join(goals), avoider=avoider)


def _error(run: Run) -> str:
    return f"{100 * run.summary['position_rmse_m']:.1f} cm RMS"


def _took(run: Run) -> str:
    """Return how long the steps between take-off and landing took."""
    steps = run.summary["steps"][1:-1]
    ends = [step["ended_s"] for step in steps if step["ended_s"] is not None]
    return f"{max(ends) - min(step['begun_s'] for step in steps):.0f} s"


def _shots(
    run: Run, moments: Sequence[float], window: tuple[int, int], size: tuple[int, int]
) -> Iterator[bytes]:
    """Yield the page of a replay at each mission time, s, as PNG, cut to a size in px."""
    times = run.arrays["time"]
    replay = Replay(run, 0.2, port=18600)
    try:
        with Chromium(replay.server.address, *GL) as chromium:
            chromium.screenshot(*window)
            chromium.wait_for("document.querySelector('canvas') !== null")
            time.sleep(LOAD)
            chromium.run(CLOSE)
            for moment in moments:
                tick = min(int(times.searchsorted(moment)), len(times) - 1)
                replay.timeline.value = float(times[tick])
                replay.show(tick)
                replay.server.flush()
                time.sleep(SETTLE if len(moments) > 1 else LOAD)
                shot = Image.open(io.BytesIO(chromium.screenshot(*window)))
                out = io.BytesIO()
                shot.crop((0, 0, *size)).save(out, "PNG")
                yield out.getvalue()
    finally:
        replay.server.close()


def _save(name: str, panels: Sequence[Panel]) -> None:
    """Write plots side by side as SVG, as the button of a report does."""
    figure = _beside(panels)
    page = render(name, [section(0, name, "", figure)])
    width, height = WIDE, figure["layout"]["height"]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "page.html"
        file.write_text(page, encoding="utf-8")
        with Chromium(file.as_uri()) as chromium:
            chromium.wait_for("document.body.dataset.ready")
            chromium.run(
                "const figure = drawn[0].figure;"
                "const layout = {...styled(figure.layout, LIGHT, false), "
                f"width: {width}, height: {height}}};"
                f"Plotly.toImage({{data: figure.data, layout}}, {{format: 'svg', width: {width}, "
                f"height: {height}}}).then(image => window.image = image);"
            )
            chromium.wait_for("window.image !== undefined")
            address = str(chromium.run("window.image"))
    head, _, data = address.partition(",")
    text = b64decode(data).decode() if head.endswith("base64") else unquote(data)
    (PICTURES / f"{name}.svg").write_text(text + "\n", encoding="utf-8")


def _beside(panels: Sequence[Panel]) -> dict[str, Any]:
    """Return one figure of several flights from above, with a title above each."""
    gap = 0.07
    share = (1 - gap * (len(panels) - 1)) / len(panels)
    data: list[Mapping[str, Any]] = []
    layout: dict[str, Any] = {"shapes": [], "annotations": [], "showlegend": False}
    layout["margin"] = {"l": 60, "r": 20, "t": 45, "b": 65}  # px
    ratio = 0.0
    for k, panel in enumerate(panels):
        figure = top_view(panel.run)
        number = str(k + 1) if k else ""
        left = k * (share + gap)
        x, y = f"x{number}", f"y{number}"
        drawn = [trace for trace in figure["data"] if trace["mode"] != "lines+markers"]
        data += [trace | {"xaxis": x, "yaxis": y} for trace in drawn]  # no closest approaches
        own = figure["layout"]
        for key in ("shapes", "annotations"):
            layout[key] += [item | {"xref": x, "yref": y} for item in own[key]]
        layout["annotations"].append({
            "text": panel.title, "showarrow": False, "xref": "paper", "yref": "paper",
            "x": left + share / 2, "y": 1, "xanchor": "center", "yanchor": "bottom",
            "font": {"size": 13},
        })  # fmt: skip
        frame = {"mirror": True, "linecolor": "#9aa0a6", "gridcolor": "#e3e6e8", "ticks": "outside"}
        layout[f"xaxis{number}"] = (
            frame | own["xaxis"] | {"domain": [left, left + share], "anchor": y}
        )
        layout[f"yaxis{number}"] = frame | own["yaxis"] | {
            "anchor": x, "scaleanchor": x, "constrain": "domain", "constraintoward": "top",
        }  # fmt: skip
        if k:
            layout[f"yaxis{number}"]["title"] = {"text": ""}
        low, high = panel.run.world.fence.low, panel.run.world.fence.high
        ratio = max(ratio, (high[1] - low[1]) / (high[0] - low[0]))
    layout["height"] = round(share * (WIDE - 80) * ratio) + 120  # more than they need
    return {"data": data, "layout": layout}


MAKERS: Final = {
    maker.__name__: maker
    for maker in (movie, pages, paper, localizers, planners, avoiders, searches)
}


def main(names: Sequence[str]) -> None:
    """Make the pictures of some names, or all."""
    with flights() as flown:
        for name in names or MAKERS:
            sys.stderr.write(f"{name}\n")
            MAKERS[name](flown)


if __name__ == "__main__":
    main(sys.argv[1:])
