"""The results of a study: comparisons by seed, tables, figures and the page."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from star_core.commands.main import main
from star_core.toolkit import ReportTable
from star_report.comparison import Result, differences, interactions, marginal_means
from star_report.drawing import ticks
from star_report.study import FILE, OUTCOME, Study, read
from star_report.tables import Strong, latex, markdown
from tests.commands import Printed
from tests.plugins.commands.star_view.chromium import CHROMIUM, Chromium

SEEDS = 6


def write(folder: Path, rows: Sequence[tuple[str, ...]], names: str, **study: Any) -> Path:
    """Write the table of a study with the columns `names` and x; `rows` have outcome after seed."""
    lines = [[*row[:-1], "", row[-1]] for row in rows]
    with (folder / FILE).open("w", newline="") as file:
        csv.writer(file).writerows([[*names.split(), "seed", "outcome", "reason", "x"], *lines])
    (folder / "study.json").write_text(json.dumps({"study": study, "command": "star ablate s"}))
    return folder


def crossed(folder: Path, skip: tuple[str, str] | None = None, **study: Any) -> Study:
    """Return a study of two factors, whose effects 10 and 100 interact by 1000, and of seeds."""
    effects = {("a0", "b0"): 0.0, ("a1", "b0"): 10.0, ("a0", "b1"): 100.0, ("a1", "b1"): 1110.0}
    rows = [
        ("hop", a, b, str(seed), "completed", repr(effects[a, b] + seed**2))
        for a in ("a0", "a1") for b in ("b0", "b1") if (a, b) != skip for seed in range(SEEDS)
    ]  # fmt: skip
    return read(write(folder, rows, "mission a b", **study))


def values(results: list[Result]) -> dict[tuple[str, ...], float]:
    return {tuple(r.levels.values()): r.mean.value for r in results if r.measure == "x"}


# Comparisons


def test_differences_are_to_the_first_condition(tmp_path: Path) -> None:
    results = differences(crossed(tmp_path))
    assert values(results) == {("a0", "b1"): 100, ("a1", "b0"): 10, ("a1", "b1"): 1110}
    assert {r.mean.n for r in results} == {SEEDS}
    assert all(r.baseline == {"a": "a0", "b": "b0"} for r in results)


def test_differences_are_to_the_baseline_at_the_same_other_levels(tmp_path: Path) -> None:
    results = differences(crossed(tmp_path, baseline={"a": "a1"}))
    assert values(results) == {("a0", "b0"): -10, ("a0", "b1"): -1010}


def test_conditions_whose_baseline_is_excluded_are_not_compared(tmp_path: Path) -> None:
    results = differences(crossed(tmp_path, ("a1", "b1"), baseline={"a": "a1"}))
    assert values(results) == {("a0", "b0"): -10}


def test_seeds_that_one_of_a_pair_lacks_are_left_out(tmp_path: Path) -> None:
    rows = [("hop", "p", str(k), "completed", str(k)) for k in range(8)]
    rows += [("hop", "q", str(k), "completed", str(2 * k) if k else "") for k in range(2, 12)]
    (result,) = differences(read(write(tmp_path, rows, "mission a")))
    assert (result.mean.n, result.mean.value) == (6, 4.5)


def test_pairs_by_seed_and_mission_are_of_all_missions(tmp_path: Path) -> None:
    rows = [
        (mission, level, "7", "completed", str(k * k + 3 * (level == "q")))
        for k, mission in enumerate(["m0", "m1", "m2", "m3", "m4"])
        for level in ("p", "q")
    ]
    apart = differences(read(write(tmp_path, rows, "mission a")))
    assert len(apart) == 5
    assert {(r.mean.n, r.mean.value, r.p) for r in apart} == {(1, 3, None)}
    for study in ({"pair": "seed and mission"}, {"seeds": "own"}):
        (pooled,) = differences(read(write(tmp_path, rows, "mission a", **study)))
        assert (pooled.levels, pooled.mean.n, pooled.mean.value) == ({"a": "q"}, 5, 3)
        assert pooled.p == 2**-4  # all of five are equal: the sign test


def test_p_values_are_corrected_over_the_table(tmp_path: Path) -> None:
    results = [r for r in differences(crossed(tmp_path)) if r.measure == "x"]
    assert [r.p for r in results] == [2**-5] * 3
    assert [r.p_holm for r in results] == [3 * 2**-5] * 3


def test_measures_that_do_not_vary_are_not_compared(tmp_path: Path) -> None:
    assert OUTCOME not in {r.measure for r in differences(crossed(tmp_path))}


def test_marginal_means_average_the_runs_of_a_seed(tmp_path: Path) -> None:
    results = marginal_means(crossed(tmp_path))
    mean_of_squares = sum(seed**2 for seed in range(SEEDS)) / SEEDS
    expected = {("a0",): 50, ("a1",): 560, ("b0",): 5, ("b1",): 605}
    assert values(results) == {k: pytest.approx(v + mean_of_squares) for k, v in expected.items()}
    assert {r.mean.n for r in results} == {SEEDS}


def test_marginal_means_compare_levels_over_the_same_conditions(tmp_path: Path) -> None:
    """Only at b0 were both levels of a flown, and only at a0 both of b."""
    results = marginal_means(crossed(tmp_path, ("a1", "b1")))
    mean_of_squares = sum(seed**2 for seed in range(SEEDS)) / SEEDS
    expected = {("a0",): 0, ("a1",): 10, ("b0",): 0, ("b1",): 100}
    assert values(results) == {k: pytest.approx(v + mean_of_squares) for k, v in expected.items()}


def test_an_interaction_is_a_difference_of_differences(tmp_path: Path) -> None:
    (result,) = interactions(crossed(tmp_path))
    assert (result.levels, result.mean.value) == ({"a": "a1", "b": "b1"}, 1000)
    (result,) = interactions(crossed(tmp_path, baseline={"a": "a1"}))
    assert (result.levels, result.mean.value) == ({"a": "a0", "b": "b1"}, -1000)
    assert interactions(crossed(tmp_path, ("a0", "b1"))) == []


def test_shares_and_their_differences_end_at_one(tmp_path: Path) -> None:
    rows = [
        ("hop", level, str(k), "completed" if k or level == "q" else "failed", str(k))
        for level in ("p", "q") for k in range(6)
    ]  # fmt: skip
    write(tmp_path, rows, "mission a")
    assert main(["report", str(tmp_path)]) == 0
    text = (tmp_path / "results.md").read_text()
    assert "| p | 6 | 83% [44%, 97%] |" in text  # Wilson
    assert "| q | 6 | 17% [-26%, 60%], p 1 |" in text


# Tables


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rows = [
        ("hop", level, str(seed), "completed" if seed else "failed", str(0.1 * seed + offset))
        for level, offset in (("none", 0.0), ("<orca>", 0.5))
        for seed in range(SEEDS)
    ]
    write(tmp_path, rows, "mission avoider", name="drift")
    text = (tmp_path / FILE).read_text().replace(",x", ",min_separation_m")
    (tmp_path / FILE).write_text(text.replace("failed,", "failed,1 | collision"))
    assert main(["report", str(tmp_path)]) == 0
    return tmp_path


def test_tables_have_labels_keys_and_what_did_not_complete(folder: Path) -> None:
    text = (folder / "results.md").read_text()
    assert text.startswith("# drift\n\n12 runs, 2 conditions; mission: hop.\n")
    assert "| avoider | n | completed | closest approach, m (`min_separation_m`) |" in text
    assert "| none | 6 | 83% [44%, 97%] | 0.25 ± 0.187 [0.0537, 0.446] |" in text
    assert "| none | 0 | failed | 1 \\| collision |" in text
    assert "## Differences to avoider: none" in text
    assert "| \\<orca> | 6 | 0%, p 1 | 0.5, p 0.062 |" in text
    assert "- seeds: 0 to 5\n" in text
    assert "- command: star ablate s\n" in text


def test_unfinished_studies_and_small_samples_are_reported(tmp_path: Path) -> None:
    rows = [("hop", "p", str(k), "completed", str(k + 0.5)) for k in range(4)]
    write(tmp_path, rows, "mission a")
    (tmp_path / "study.json").write_text('{"runs": 9}')
    assert main(["report", str(tmp_path)]) == 0
    text = (tmp_path / "results.md").read_text()
    assert "4 of 9 runs, 1 condition; a: p." in text
    assert "| hop | 4 | 100% | 2 ± 1.29 |" in text


def test_significant_differences_are_in_bold(tmp_path: Path) -> None:
    rows = [
        ("hop", a, str(k), "completed", str(k + 9 * (a == "q"))) for a in "pq" for k in range(7)
    ]
    write(tmp_path, rows, "mission a")
    assert main(["report", str(tmp_path)]) == 0
    assert "| q | 7 | **9, p 0.016** |" in (tmp_path / "results.md").read_text()
    assert "<b>9, p 0.016</b>" in (tmp_path / "report.html").read_text()


def test_statistics_have_full_precision(folder: Path) -> None:
    with (folder / "statistics.csv").open() as file:
        rows = {(r["table"], r["avoider"], r["measure"]): r for r in csv.DictReader(file)}
    row = rows["condition", "none", "min_separation_m"]
    assert (float(row["mean"]), row["interval"], row["n"]) == (0.25, "t", "6")
    assert (float(row["median_low"]), float(row["median_high"])) == (0, 0.5)
    row = rows["difference", "<orca>", "min_separation_m"]
    assert (row["baseline"], float(row["p"])) == ("avoider: none", 2**-5)


def test_latex_escapes_what_has_a_meaning() -> None:
    rows = [["a_b & c", "5", Strong("-0.5 ± 1 [-1, 2e-05]")]]
    text = latex(
        ReportTable("100 %", "", ["mission"], [("n", ""), ("length, m", "length_m")], rows)
    )
    assert r"\caption{100 \%. }" in text
    assert r" &  & \texttt{length\_m} \\" in text
    assert r"a\_b \& c & 5 & \textbf{$-$0.5 $\pm$ 1 [$-$1, 2e-05]} \\" in text


def test_markdown_keeps_cells_on_their_line() -> None:
    text = markdown(ReportTable("t", "note", ["a"], [("n", "")], [["x|y\nz", Strong("3")]]))
    assert text == "note\n\n| a | n |\n| --- | ---: |\n| x\\|y z | **3** |\n"


# Figures and page


def test_every_run_is_a_point_and_every_seed_a_line(folder: Path) -> None:
    root = ET.parse(folder / "figure-min-separation-m.svg").getroot()  # noqa: S314 -- ours
    marks = [element.get("class") for element in root.iter()]
    assert (marks.count("run"), marks.count("pair"), marks.count("dot")) == (12, 6, 2)
    titles = [e.text for e in root.iter("{http://www.w3.org/2000/svg}title")]
    assert "seed 2: 0.7" in titles


def test_many_runs_are_a_histogram(tmp_path: Path) -> None:
    rows = [("hop", "p", str(k), "completed", str(k % 50)) for k in range(1000)]
    write(tmp_path, rows, "mission a")
    assert main(["report", str(tmp_path)]) == 0
    root = ET.parse(tmp_path / "figure-x.svg").getroot()  # noqa: S314 -- ours
    counts = [int(c) for c in re.findall(r": (\d+) runs", ET.tostring(root, "unicode"))]
    assert sum(counts) == 1000
    assert len(counts) == 50


def test_axes_have_round_numbers() -> None:
    assert ticks(-0.3, 7.2) == [0, 2, 4, 6]
    assert ticks(1e6, 1e6 + 1) == [1e6 + k / 5 for k in range(6)]


def test_page_escapes_names_and_needs_no_network(folder: Path) -> None:
    page = (folder / "report.html").read_text()
    assert "<orca>" not in page
    assert "&lt;orca&gt;" in page
    assert "<h2>closest approach, m<code>min_separation_m</code>" in page
    assert "<dt>seeds</dt><dd>0 to 5</dd>" in page
    assert not re.search(r'(src|href)="?(http|/)', page)


def test_a_page_elsewhere_leaves_the_folder_alone(folder: Path, tmp_path: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert main(["report", str(folder), "-o", str(tmp_path / "page.html")]) == 0
    assert {p: p.stat().st_mtime_ns for p in folder.iterdir() if p.name != "page.html"} == before


def test_the_report_of_many_conditions_is_small(tmp_path: Path) -> None:
    rows = [
        ("hop", f"a{a}", f"b{b}", str(k), "failed", repr(1 / (1 + a + b + k)))
        for a in range(20) for b in range(10) for k in range(5)
    ]  # fmt: skip
    write(tmp_path, rows, "mission a b")
    assert main(["report", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text()
    assert len(page) < 300_000
    assert "The first 100 of 1000; results.csv has all." in page
    assert page.count('class="dot"') == 30  # of each level


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_page_fits_a_phone(folder: Path) -> None:
    with Chromium((folder / "report.html").as_uri()) as chromium:
        chromium.screenshot(400, 800)
        chromium.wait_for("document.body.dataset.ready")
        assert chromium.run("document.documentElement.scrollWidth") <= 400
        assert chromium.run("document.querySelector('svg').getBoundingClientRect().width") > 300
        chromium.run("HTMLAnchorElement.prototype.click = function () { window.saved = this.href }")
        chromium.run("document.querySelector('.save').click()")
        saved = chromium.run("decodeURIComponent(window.saved)").partition(",")[2]
    assert ET.fromstring(saved).get("width") == "640"  # noqa: S314 -- ours


def test_extreme_and_missing_values_are_reported(tmp_path: Path) -> None:
    values = ["1e100", "-1e100", "0", "NaN", "", "[1]", "true"] * 6
    rows = [("hop", a, str(k), "completed", value) for a in "pq" for k, value in enumerate(values)]
    write(tmp_path, rows, "mission a", name=3, baseline={"a": "gone"}, pair=[])
    assert main(["report", str(tmp_path)]) == 0
    text = (tmp_path / "results.md").read_text()
    assert re.search(r"\| p \| 42 \| 100% \[92%, 100%\] \| .* \(n 24\) \|", text)
    assert max(map(len, text.splitlines())) < 500


def test_a_study_without_a_run_has_a_report(tmp_path: Path) -> None:
    write(tmp_path, [], "mission a", name="none")
    assert main(["report", str(tmp_path)]) == 0
    assert "0 runs, 0 conditions." in (tmp_path / "report.html").read_text()


def test_another_table_is_refused(tmp_path: Path, capsys: Printed) -> None:
    (tmp_path / FILE).write_text("a,b\n1,2\n")
    assert main(["report", str(tmp_path)]) == 2
    assert "[no-record]" in capsys.readouterr().err
