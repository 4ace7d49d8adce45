"""The table of all drones, and what it is named after."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import star_sim
from star_sim.drone import DRONE, standing


def test_drones_stand_where_they_are_put_with_their_motors_off() -> None:
    drones = standing(np.array([[1.0, 2.0, 0.5]]), np.array([np.pi / 2]), 0.5)
    assert drones["position"].tolist() == [[1.0, 2.0, 0.5]]
    assert np.allclose(drones["attitude"], [[0, 0, 0.5**0.5, 0.5**0.5]])
    assert drones["voltage"] == 3.92
    assert not drones["thrust"].any()


def test_a_change_in_any_source_asks_for_another_kernel(tmp_path: Path) -> None:
    copy = tmp_path / "star_sim"
    shutil.copytree(Path(star_sim.__file__).parent, copy, ignore=lambda *_: ["__pycache__"])
    names = [DRONE.names]
    for _ in range(2):
        told = subprocess.run(
            [sys.executable, "-c", "from star_sim.drone import DRONE; print(DRONE.names[-1])"],
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            check=True,
            text=True,
        )
        names.append((told.stdout.strip(),))
        with (copy / "airframe.py").open("a") as source:
            source.write("# heavier\n")
    assert names[0] is not None
    assert names[1] == names[0][-1:]
    assert names[2] != names[1]
