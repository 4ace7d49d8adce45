"""The linter's contract that plugins import the public API only."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("planted", "kept"),
    [
        ("from star_core.testing import scene", True),
        ("from star_core import Scene", True),
        ("from star_core.toolkit import compiled", True),
        ("from star_core.toolkit.jit import compiled", False),
        ("from star_core.commands import writing", True),
        ("from star_core.commands.output import writing", False),
        ("from star_core.vehicle_interface import VehicleInterface", False),
        ("from star_core.messages.state import Setpoint", False),
        ("from star_core import tick", False),
    ],
)
def test_a_plugin_that_imports_a_private_module_breaks_the_contract(
    tmp_path: Path,
    planted: str,
    kept: bool,  # noqa: FBT001 -- what is expected
) -> None:
    plugin = tmp_path / "star_none"
    shutil.copytree(ROOT / "plugins" / "avoiders" / "star_none", plugin)
    (plugin / "planted.py").write_text(f"{planted}\n")
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--config", ROOT / "pyproject.toml",
         "--no-cache", "--contract", "public-api"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode == 0) is kept, done.stdout
    assert kept or "star_none.planted -> star_core." in done.stdout
