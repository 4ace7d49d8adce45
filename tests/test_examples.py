"""What is in ``examples/`` runs.

``external_goals.py`` flies in ``tests/plugins/tasks/star_external/test_flight.py``.
"""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"


def test_missions_fly_from_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / "fly_from_python.py"))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "cf1 cf2 cf3 fly in lab-4x4"
    assert [line.split()[0] for line in lines[1:]] == ["radius", "0.2", "0.3", "0.2", "0.3"]
    assert sorted(folder.name for folder in Path("runs").iterdir()) == ["radius-0.2", "radius-0.3"]


def test_the_readme_of_the_examples_names_all_of_them() -> None:
    named = re.findall(r"\]\(([^./)]+(?:\.py)?)\)", (EXAMPLES / "README.md").read_text())
    assert sorted(named) == sorted({path.name for path in EXAMPLES.iterdir()} - {"README.md"})
