"""Exported files hold the record, and evo reads them."""

from __future__ import annotations

import csv
import math
import os
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from star_core import Run
from star_core.commands.main import main
from star_core.toolkit import Progress
from tests.commands import Printed


@pytest.mark.extended
def test_evo_computes_the_position_error_of_the_summary(
    run: Run, tmp_path: Path, capsys: Printed
) -> None:
    """evo is GPL-3: it is called as a program, and not imported."""
    assert main(["export", str(run.folder), "--format", "tum", "-o", str(tmp_path)]) == 0
    files = capsys.readouterr().out.splitlines()
    assert [Path(file).name for file in files] == [
        "cf1-estimate.tum", "cf1-ground_truth.tum", "cf2-estimate.tum", "cf2-ground_truth.tum",
    ]  # fmt: skip
    for agent, estimate, truth in (("cf1", *files[:2]), ("cf2", *files[2:])):
        ape = subprocess.run(
            [Path(sys.executable).with_name("evo_ape"), "tum", truth, estimate],
            env={**os.environ, "HOME": str(tmp_path)},  # it writes its settings there
            capture_output=True,
            text=True,
            check=True,
        )
        rmse = float(re.findall(r"rmse\s+(\S+)", ape.stdout)[0])
        expected = math.sqrt(run.summary["position_mse_m2"]["per_agent"][agent])
        assert rmse == pytest.approx(expected, abs=1e-6)


def test_a_table_has_every_array_with_a_line_per_tick(run: Run, tmp_path: Path) -> None:
    assert main(["export", str(run.folder), "--format", "csv", "-o", str(tmp_path)]) == 0
    with (tmp_path / "cf2.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(run.arrays["time"])
    for column, array in (
        ("time", run.arrays["time"]),
        ("phase", run.arrays["phase"][:, 1]),
        ("truth_position_z", run.arrays["truth_position"][:, 1, 2]),
        ("truth_attitude_w", run.arrays["truth_attitude"][:, 1, 3]),
    ):
        assert [float(row[column]) for row in rows] == pytest.approx(array.tolist(), nan_ok=True)


def test_a_flight_without_ground_truth_has_estimates_only(run: Run, tmp_path: Path) -> None:
    for file in ("manifest.json", "summary.json"):
        (tmp_path / file).write_bytes((run.folder / file).read_bytes())
    with np.load(run.folder / "trajectory.npz") as kept:
        np.savez(
            tmp_path / "trajectory.npz",
            **{name: kept[name] for name in kept.files if not name.startswith("truth")},
        )
    assert main(["export", str(tmp_path), "--format", "tum"]) == 0
    assert len(list((tmp_path / "tum").iterdir())) == 2


def test_a_folder_that_cannot_be_made_is_reported(
    run: Run, tmp_path: Path, capsys: Printed
) -> None:
    (tmp_path / "file").touch()
    assert main(["export", str(run.folder), "--format", "tum", "-o", str(tmp_path / "file")]) == 2
    assert "[unwritable-file]" in capsys.readouterr().err


def test_an_export_that_takes_long_shows_its_progress(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.setattr("star_export.command.Progress", partial(Progress, announced=True))
    command = ["export", str(run.folder), "--format", "tum", "-o", str(tmp_path)]
    assert main(command) == 0
    printed = capsys.readouterr()
    assert f"exporting {run.folder}" in printed.err
    assert len(printed.out.splitlines()) == len(list(tmp_path.iterdir())) > 0
