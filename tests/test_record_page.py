"""docs/record.md lists every array and every key that a flight records."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path

import numpy as np

from star_core import Detections
from star_core.commands.main import main

PAGE = Path(__file__).parents[1] / "docs" / "record.md"


def test_every_array_and_key_is_described(hop: Path) -> None:
    assert main(["run", "hop.yaml", "--out", "run"]) == 0
    pattern = re.compile(r"^## `([a-z.]+)`\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
    sections = dict(pattern.findall(PAGE.read_text()))
    described = {
        name: {
            word
            for line in re.findall(r"^\| (`.*?) \|", text, re.MULTILINE)
            for word in re.findall(r"`(\w+)`", line)
        }
        for name, text in sections.items()
    }
    arrays = set(np.load(hop / "run" / "trajectory.npz").files)
    assert arrays == described["trajectory.npz"] - {"signal"}  # there is no radio
    assert set(np.load(hop / "run" / "timing.npz").files) == described["timing.npz"]
    assert set(np.load(hop / "run" / "paths.npz").files) == described["paths.npz"]
    assert {field.name for field in fields(Detections)} == described["detections.npz"]
    summary = json.loads((hop / "run" / "summary.json").read_text())
    assert set(summary) == described["summary.json"]
    assert set(json.loads((hop / "run" / "timing.json").read_text())) == described["timing.json"]
    assert set(summary["steps"][0]) == described["steps"] - {"causes"}  # it did not fail
