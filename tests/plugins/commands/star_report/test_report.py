"""The page of a flight: complete, readable by itself, and the same figures as the summary."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from star_core import AgentPhase, Run, read_run
from star_core.cli.main import main
from star_report.figures import replay, top_view
from star_report.series import clearance, errors, separation

MISSION = """\
star: 1
name: swap
world: room.yaml
seed: 7
swarm: {cf1: {start: [-0.6, 0, 0]}, cf2: {start: [0.6, 0.1, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.4, speed: 0.5}
  - goto: {agents: cf1, by: [0.6, 0.5, 0]}
  - land: {speed: 0.5}
"""
WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles: {pillar: {polygon: [[1, 1], [1.2, 1], [1.2, 1.2], [1, 1.2]], height: [0, 2]}}
landmarks: {door: {tags: [3], at: [0, 1.5, 0]}}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("report")
    (folder / "room.yaml").write_text(WORLD)
    (folder / "swap.yaml").write_text(MISSION)
    assert main(["run", str(folder / "swap.yaml"), "--out", str(folder / "run")]) == 0
    return read_run(folder / "run")


def test_the_page_needs_no_network_and_shows_all_sections(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "page.html"
    assert main(["report", str(run.folder), "-o", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    page = out.read_text()
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", page)
    titles = re.findall(r"<h2>(.*?)</h2>", page)
    assert titles == [
        "Top view", "Replay", "Position error", "Separation", "Clearance", "Altitude", "Battery",
        "Steps", "Computing time", "Events",
    ]  # fmt: skip
    figures = re.findall(r"data-figure=\d+>(.*?)</script>", page, re.DOTALL)
    assert all(json.loads(figure)["data"] for figure in figures)
    assert len(page) < 5_000_000


def test_closest_approaches_are_those_of_the_summary(run: Run) -> None:
    near, clear = separation(run), clearance(run)
    assert near.tick is not None
    assert clear.tick is not None
    assert near.distance[near.tick] == pytest.approx(run.summary["min_separation_m"], abs=1e-6)
    assert clear.distance[clear.tick] == pytest.approx(run.summary["min_clearance_m"], abs=1e-6)
    assert clear.names == "cf2 and pillar"


def test_errors_are_bounded_by_what_the_covariance_expects(run: Run) -> None:
    found = errors(run)
    assert found is not None
    error, bound = found
    flying = run.arrays["phase"] == AgentPhase.FLYING
    assert error[flying].max() == pytest.approx(run.summary["position_worst_m"])
    assert (error[np.isfinite(error)] < bound[np.isfinite(error)]).all()


def test_the_world_is_in_the_views(run: Run) -> None:
    figure = top_view(run)
    assert len(figure["layout"]["shapes"]) == 2  # fence and pillar
    assert {"landmarks", "cf1", "cf1, estimate"} <= {trace.get("name") for trace in figure["data"]}
    moving = replay(run)
    frames = len(moving["time"])
    assert moving["path"].shape == (frames * 2 * 3,)
    assert moving["time"][-1] == pytest.approx(run.arrays["time"][-1], abs=0.11)
    assert [trace["type"] for trace in moving["data"]].count("mesh3d") == 1


def test_an_estimate_without_truth_has_no_error_figure(run: Run, tmp_path: Path) -> None:
    for file in run.folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    kept = dict(np.load(run.folder / "trajectory.npz"))
    known = {name: kept[name] for name in kept if not name.startswith("truth")}
    np.savez(tmp_path / "trajectory.npz", **known)
    assert main(["report", str(tmp_path)]) == 0
    assert "Position error</h2>" not in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("missing", ["manifest.json", "summary.json", "trajectory.npz"])
def test_an_incomplete_record_is_refused(
    missing: str, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in run.folder.iterdir():
        if file.name != missing:
            (tmp_path / file.name).write_bytes(file.read_bytes())
    assert main(["report", str(tmp_path)]) == 2
    assert f"no '{missing}' [no-record]" in capsys.readouterr().err
