"""The headline of docs/results.md, flown again."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from star_core.cli.main import main

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
    found = {}
    for row, level in ROWS.items():
        (line,) = re.findall(rf"^\| {re.escape(row)} \|(.*)\|$", section, re.MULTILINE)
        for path, cell in zip(PATHS, line.split("|"), strict=True):
            low, high = re.findall(r"\[([\d.]+), ([\d.]+)\]", cell)[0]
            found[path, level] = float(low), float(high)
    return found


def flown(folder: Path) -> dict[tuple[str, str], float]:
    """Return the mean over the seeds of a study, m², by path and level."""
    errors: dict[tuple[str, str], list[float]] = {}
    with (folder / "results.csv").open() as file:
        for row in csv.DictReader(file):
            key = row["mission"], row["localisation"]
            errors.setdefault(key, []).append(float(row["position_mse_m2.mean"]))
    return {key: float(np.mean(each)) for key, each in errors.items()}


@pytest.mark.campaign
@pytest.mark.shipped_world
def test_each_published_error_lies_in_its_interval(tmp_path: Path) -> None:
    assert main(["ablate", str(STUDY), "--out", str(tmp_path / "out")]) == 0
    means = flown(tmp_path / "out")
    intervals = published()
    assert means.keys() == intervals.keys()
    outside = {k: means[k] for k, (low, high) in intervals.items() if not low <= means[k] <= high}
    assert not outside
