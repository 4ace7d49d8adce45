"""The headline of docs/results.md, flown again."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from star_core.commands.main import main

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "missions/studies/paper-table-1-realistic.yaml"
PATHS = ("paper_box", "paper_circle", "paper_figure8")
ROWS = {
    "no tag (`flow`)": "no tag",
    "1 tag": "1 tag",
    "2 tags": "2 tags",
    "2 tags, `method: batch`": "2 tags - batch",
}  # of the page, and the level of the study


def published() -> dict[tuple[str, str], tuple[float, float]]:
    """Return the interval of each mean square error, m², by path and level."""
    page = (ROOT / "docs/results.md").read_text()
    section = page.split("## Table 1 in the default world")[1].split("\n## ")[0]
    intervals = {}
    for row, level in ROWS.items():
        (line,) = re.findall(rf"^\| {re.escape(row)} \|(.*)\|$", section, re.MULTILINE)
        for path, cell in zip(PATHS, line.split("|"), strict=True):
            low, high = re.findall(r"\[([\d.]+), ([\d.]+)\]", cell)[0]
            intervals[path, level] = float(low), float(high)
    return intervals


def flown(folder: Path, measure: str) -> dict[tuple[str, str], float]:
    """Return the mean of a measure over the seeds of a study, by path and level."""
    values: dict[tuple[str, str], list[float]] = {}
    with (folder / "results.csv").open() as file:
        for row in csv.DictReader(file):
            key = row["mission"], row["localisation"]
            values.setdefault(key, []).append(float(row[measure]))
    return {key: float(np.mean(each)) for key, each in values.items()}


@pytest.mark.campaign
def test_published_errors_and_covariances_are_reproduced(tmp_path: Path) -> None:
    assert main(["ablate", str(STUDY), "--out", str(tmp_path / "out")]) == 0
    means = flown(tmp_path / "out", "position_mse_m2.mean")
    intervals = published()
    assert means.keys() == intervals.keys()
    outside = {k: means[k] for k, (low, high) in intervals.items() if not low <= means[k] <= high}
    assert not outside
    nees = flown(tmp_path / "out", "position_nees")
    for tags, least in (("1 tag", 0.5), ("2 tags", 0.7)):
        assert all(least <= nees[path, tags] <= 1.5 for path in PATHS)
