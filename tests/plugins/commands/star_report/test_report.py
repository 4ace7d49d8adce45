"""The page of a flight: complete, readable by itself, and the same figures as the summary."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
import pytest

from star_core import AgentPhase, InputError, Registry, Run, hookimpl
from star_core.commands import write_report
from star_core.commands.main import main
from star_core.toolkit import WrittenReport
from star_report.charts import series, tick_times
from star_report.page import page
from star_report.series import clearance, errors, separation
from star_report.views import replay, top_view
from tests.commands import Printed
from tests.plugins.commands.star_view.chromium import CHROMIUM, Chromium


def test_the_page_needs_no_network_and_shows_all_sections(
    run: Run, tmp_path: Path, capsys: Printed
) -> None:
    out = tmp_path / "page.html"
    assert main(["report", str(run.folder), "-o", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    page = out.read_text()
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", page)
    titles = re.findall(r"<h2>(.*?)<", page)
    assert titles == [
        "Top view", "Replay", "Position error", "Separation", "Clearance", "Altitude", "Battery",
        "Steps", "Tick times", "Computing time", "Events", "How this was made",
    ]  # fmt: skip
    figures = re.findall(r"data-figure=\d+>(.*?)</script>", page, re.DOTALL)
    assert all(json.loads(figure)["data"] for figure in figures)
    assert len(page) < 5_000_000


LEGEND = (  # px, how much of the plot it covers
    "drawn[0].querySelector('.legend').getBoundingClientRect().bottom"
    " - drawn[0].getBoundingClientRect().top - drawn[0]._fullLayout._size.t"
)


NAMES = (  # that cover no others
    "[...drawn[0].querySelectorAll('.textpoint, .annotation-text')]"
    ".filter(name => name.style.visibility !== 'hidden').map(name => name.textContent).join(' ')"
)


@pytest.mark.extended
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_no_text_covers_another_after_a_resize(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    assert main(["report", str(run.folder), "-o", str(out)]) == 0
    with Chromium(out.as_uri()) as chromium:
        chromium.wait_for("document.body.dataset.ready")
        for width in (1400, 400):
            chromium.screenshot(width, 900)
            chromium.wait_for("Math.abs(drawn[0]._fullLayout.width - drawn[0].clientWidth) < 1")
            chromium.wait_for(f"{LEGEND} <= 1")
            assert chromium.run(NAMES) == "300 pillar"


def test_the_page_has_the_command_commit_and_seed(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("star_report.page._plotly", lambda: "")  # which takes a second
    software = {"command": "star run <swap>.yaml", "commit": "0123abc-dirty"}
    changed = replace(run, manifest={**run.manifest, **software})
    rows = dict(re.findall(r"<dt>(.*?)</dt><dd>(?:<code>)?(.*?)(?:</code>)?</dd>", page(changed)))
    assert rows["command"] == "star run &lt;swap&gt;.yaml"
    assert rows["seed"] == "7"
    assert rows["STAR"] == f"star-swarm {version('star-swarm')}, commit 0123abc-dirty"
    older = {key: run.manifest[key] for key in ("mission_file", "plugins")}
    assert "<dt>STAR" not in page(replace(run, manifest=older))


def test_closest_approaches_are_those_of_the_summary(run: Run) -> None:
    near, clear = separation(run), clearance(run)
    assert near.tick is not None
    assert clear.tick is not None
    assert near.distance[near.tick] == pytest.approx(run.summary["min_separation_m"], abs=1e-6)
    assert clear.distance[clear.tick] == pytest.approx(run.summary["min_clearance_m"], abs=1e-6)
    assert clear.text.startswith(f"cf2 and pillar: {clear.least:.2f} m at ")


def test_errors_are_bounded_by_what_the_covariance_expects(run: Run) -> None:
    series = errors(run)
    assert series is not None
    error, bound = series
    flying = run.arrays["phase"] == AgentPhase.FLYING
    assert error[flying].max() == pytest.approx(run.summary["position_worst_m"])
    assert (error[np.isfinite(error)] < bound[np.isfinite(error)]).all()


def test_virtual_obstacles_are_drawn_fainter(run: Run) -> None:
    (pillar,) = run.world.obstacles
    marked = replace(run, world=replace(run.world, virtual=(replace(pillar, name="marked"),)))
    layout = top_view(marked)["layout"]
    assert [shape.get("opacity") for shape in layout["shapes"]] == [None, 0.55, 0.15]
    assert [name["text"] for name in layout["annotations"]] == ["pillar", "marked"]
    meshes = [trace for trace in replay(marked)["data"] if trace["type"] == "mesh3d"]
    assert [mesh["opacity"] for mesh in meshes[:2]] == [0.55, 0.15]
    colours = re.findall(r"fill='(#\w+)'", getattr(marked, "_repr_html_")())  # noqa: B009 -- of IPython, which types do not know
    assert colours == ["#e8e8e8", "#bbb"]


def test_the_world_is_in_the_views(run: Run) -> None:
    figure = top_view(run)
    assert len(figure["layout"]["shapes"]) == 2  # fence and pillar
    assert {"landmarks", "cf1", "cf1, estimate"} <= {trace.get("name") for trace in figure["data"]}
    moving = replay(run)
    frames = len(moving["time"])
    assert moving["path"].shape == (frames * 2 * 3,)
    assert moving["time"][-1] == pytest.approx(run.arrays["time"][-1], abs=0.11)
    assert [trace["type"] for trace in moving["data"]].count("mesh3d") == 1


def test_the_replay_has_the_planned_paths(run: Run) -> None:
    moving = replay(run)
    planned = moving["planned"].reshape(-1, 2)
    lengths = [len(moving["points"][k]) for k in planned[:, 0].tolist()]
    assert lengths[-1] == 0  # landed
    frame = int(np.argmax(lengths))
    tick = int(np.searchsorted(run.arrays["time"], moving["time"][frame] - 1e-4))
    goal = run.arrays["goal_position"][tick, 0]
    assert moving["points"][planned[frame, 0]] == pytest.approx(goal[None])
    estimate = moving["here"].reshape(-1, 2, 3)[frame]
    assert estimate == pytest.approx(run.arrays["estimate_position"][tick], abs=1e-6)


def test_an_estimate_without_truth_has_no_error_figure(run: Run, tmp_path: Path) -> None:
    for file in run.folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    kept = dict(np.load(run.folder / "trajectory.npz"))
    arrays = {name: kept[name] for name in kept if not name.startswith("truth")}
    np.savez(tmp_path / "trajectory.npz", **arrays)
    assert main(["report", str(tmp_path)]) == 0
    assert "Position error</h2>" not in (tmp_path / "report.html").read_text()


def test_images_with_detections_show_tags_and_rejection_reasons(run: Run, tmp_path: Path) -> None:
    shutil.copytree(run.folder, tmp_path, dirs_exist_ok=True)
    frames = tmp_path / "frames" / "cf2"
    frames.mkdir(parents=True)
    for k in range(30):
        cv2.imwrite(str(frames / f"{100 * k:07d}.png"), np.full((120, 160), 200, np.uint8))
    assert main(["report", str(tmp_path)]) == 0
    assert "no detections" in (tmp_path / "report.html").read_text()
    np.savez(
        tmp_path / "detections.npz",
        agent=[1, 1, 1, 0],
        tag=[11, 23, 24, 5],
        corners=np.tile([[50, 90], [110, 90], [110, 30], [50, 30]], (4, 1, 1)),
        taken=[1.1, np.nan, np.nan, 1.2],
        arrived=[1.3, 2.3, 2.3, 1.3],
        rejected=["", "", "too far", ""],
    )
    assert main(["report", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text()
    captions = re.findall(r"<figcaption>(.*?)<", page)
    assert captions == ["cf2, 1.10 s: tag 11", "cf2, 2.30 s: tags 23, 24 (too far)"]
    assert "In 2 of 30 images" in page


def test_approaches_of_agents_are_marked_beside_the_closest(run: Run) -> None:
    tick = len(run.arrays["time"]) // 2
    moment = float(run.arrays["time"][tick])
    details = {"agents": ["cf1", "cf2"], "time_s": moment}
    event = {"time": moment, "kind": "close_approach", "text": "close", "details": details}
    changed = replace(run, summary={**run.summary, "events": [event]})
    figures = {title: figure for title, _, figure in series(changed)}
    assert figures["Separation"]["data"][1]["x"][1:] == [moment]
    assert figures["Separation"]["data"][1]["text"][1:] == ["close"]
    assert len(figures["Clearance"]["data"][1]["x"]) == 1


def test_the_longest_ticks_are_shown_however_long_the_flight(run: Run) -> None:
    n = 10_000
    time = np.linspace(0.0, 0.05 * (n - 1), n)
    spent = np.full(n, 1e-3)
    spent[4321] = 0.5
    stages = dict.fromkeys(("localizer", "planner", "avoider", "safety", "tick"), spent)
    long = replace(run, timing={"time": time, "late": np.zeros(n), **stages})
    ((_, caption, figure),) = tick_times(long)
    assert "50 ms" in caption
    assert max(figure["data"][0]["y"]) == 500
    assert len(figure["data"][0]["y"]) <= 1500
    assert "lateness" not in [line["name"] for line in figure["data"]]
    assert list(tick_times(replace(run, timing={}))) == []


def test_a_flight_reports_on_request(run: Run, tmp_path: Path, capsys: Printed) -> None:
    mission = str(run.folder.parent / "swap.yaml")
    out = tmp_path / "out"
    assert main(["run", mission, "--out", str(out), "--report"]) == 0
    assert f"report: {out / 'report.html'}\n" in capsys.readouterr().err
    assert "<h1>swap <span" in (out / "report.html").read_text()
    assert main(["run", mission, "--no-record", "--report"]) == 0
    assert "no report without a record" in capsys.readouterr().err


def test_reports_without_plotly_name_the_package_before_flight(
    run: Run, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.setattr("star_report.command.find_spec", lambda _name: None)
    mission = str(run.folder.parent / "swap.yaml")
    assert main(["run", mission, "--no-record", "--report"]) == 2
    assert "pip install 'star-swarm[report]' [missing-package]" in capsys.readouterr().err
    line, report = write_report(run.folder, Registry())
    assert report is None
    assert line == "no report: star report needs plotly: pip install 'star-swarm[report]'"


class Sketch:
    """A plugin that writes reports of its own, or raises."""

    def __init__(self, error: Exception | None = None) -> None:
        self._error = error

    @hookimpl
    def star_report(self, folder: Path) -> WrittenReport:
        if self._error is not None:
            raise self._error
        return WrittenReport(folder / "sketch.svg")


@pytest.mark.parametrize(
    ("plugins", "line"),
    [
        ((), "no report: no installed plugin writes one"),
        ((Sketch(),), "report: run/sketch.svg"),
        ((Sketch(InputError("no pencil")),), "no report: no pencil"),
        ((Sketch(ValueError("no pencil")),), "no report: star_report of .*: ValueError: no pencil"),
    ],
)
def test_reports_are_written_by_a_hook(plugins: tuple[object, ...], line: str) -> None:
    assert re.match(line, write_report(Path("run"), Registry(*plugins, installed=False))[0])


@pytest.mark.parametrize("missing", ["manifest.json", "summary.json", "trajectory.npz"])
def test_an_incomplete_record_is_refused(
    missing: str, run: Run, tmp_path: Path, capsys: Printed
) -> None:
    for file in run.folder.iterdir():
        if file.name != missing:
            (tmp_path / file.name).write_bytes(file.read_bytes())
    assert main(["report", str(tmp_path)]) == 2
    assert f"no '{missing}' [no-record]" in capsys.readouterr().err
