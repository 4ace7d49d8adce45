"""The page of a study: measures by condition, differences by seed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from star_core.commands.main import main
from star_report.study import FILE, differences, figure, interval, read
from tests.plugins.commands.star_view.chromium import CHROMIUM, Chromium

TABLE = """\
mission,avoider,seed,outcome,reason,min_separation_m,targets.list
hop.yaml,none,0,completed,,0.1,[]
hop.yaml,none,1,failed,1 collision,0.2,[]
hop.yaml,none,2,completed,,,[]
hop.yaml,<orca>,0,completed,,0.4,[]
hop.yaml,<orca>,1,completed,,0.6,[]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / FILE).write_text(TABLE)
    return tmp_path


def test_differences_are_paired_by_seed(folder: Path) -> None:
    study = read(folder)
    assert list(study.conditions) == ["none", "<orca>"]
    assert study.measures == ["min_separation_m"]
    found = differences(study, "min_separation_m")["<orca>"]
    assert found is not None
    assert found.n == 2
    assert found.mean == pytest.approx(0.35)
    half = 12.706204736 * 0.05  # quantile of Student's t, standard error
    assert found.high - found.mean == pytest.approx(half)


def test_every_run_is_a_point_and_every_seed_a_line(folder: Path) -> None:
    lines, points, means = figure(read(folder), "min_separation_m")["data"]
    assert sorted(points["x"]) == [0.1, 0.2, 0.4, 0.6]
    assert lines["x"] == [0.1, 0.4, None, 0.2, 0.6, None]
    assert means["x"] == pytest.approx([0.15, 0.5])


def test_differences_are_to_the_first_condition_per_mission(folder: Path) -> None:
    other = TABLE.partition("\n")[2].replace("hop", "fly").replace("0.1,", "0.3,")
    (folder / FILE).write_text(TABLE + other)
    study = read(folder)
    assert study.baselines["fly.yaml, <orca>"] == "fly.yaml, none"
    found = differences(study, "min_separation_m")
    assert list(found) == ["hop.yaml, <orca>", "fly.yaml, <orca>"]
    means = [one.mean for one in found.values() if one is not None]
    assert means == pytest.approx([0.35, 0.25])


def test_levels_are_prefixed_by_their_factor_if_several(folder: Path) -> None:
    lines = TABLE.replace("avoider,", "avoider,noise,").replace("orca>,", "orca>,on,")
    (folder / FILE).write_text(lines.replace("none,", "none,on,"))
    assert list(read(folder).conditions) == [
        "avoider: none, noise: on",
        "avoider: <orca>, noise: on",
    ]


def test_a_measure_that_is_the_same_in_all_runs_needs_no_figure(folder: Path) -> None:
    (folder / FILE).write_text(
        TABLE.replace("0.1,", "0.4,").replace("0.2,", "0.4,").replace("0.6,", "0.4,")
    )
    assert main(["report", str(folder)]) == 0
    assert "0.4 in all runs in which it is known" in (folder / "report.html").read_text()


def test_the_name_is_that_of_the_study(folder: Path) -> None:
    assert read(folder).name == folder.name
    (folder / "study.json").write_text('{"study": {"name": "drift"}}')
    assert read(folder).name == "drift"


def test_one_value_has_no_interval() -> None:
    found = interval([2.0])
    assert found is not None
    assert math.isnan(found.low)
    assert interval([]) is None


def test_means_of_counts_are_not_negative() -> None:
    counts = [0.0, 0.0, 2.0]
    mean, difference = interval(counts), interval(counts, differences=True)
    assert mean is not None
    assert difference is not None
    assert (mean.low, mean.high) == (0.0, difference.high)
    assert difference.low < 0


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_page_fits_a_phone_and_paper(folder: Path) -> None:
    assert main(["report", str(folder)]) == 0
    with Chromium((folder / "report.html").as_uri()) as chromium:
        chromium.screenshot(400, 800)
        chromium.wait_for("document.body.dataset.ready")
        assert chromium.run("document.documentElement.scrollWidth") <= 400
        chromium.run("dispatchEvent(new Event('beforeprint'))")
        assert chromium.run("document.querySelector('.main-svg').clientWidth") == 680


def test_page_escapes_names_and_shows_completion_rates(folder: Path) -> None:
    assert main(["report", str(folder)]) == 0
    page = (folder / "report.html").read_text()
    assert "<orca>" not in page.split("<script", 1)[0]
    assert "67% [21%, 94%]" in page  # 2 of 3, by Wilson
    assert "0.35 [-0.285, 0.985]" in page
    assert "<td>none<td>1<td>failed<td>1 collision" in page
    assert "<h2>closest approach (m)<code>min_separation_m</code>" in page
    assert "<dt>seeds</dt><dd>0, 1, 2</dd>" in page


def test_another_table_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / FILE).write_text("a,b\n1,2\n")
    assert main(["report", str(folder)]) == 2
    assert "[no-record]" in capsys.readouterr().err
