"""Fly a mission with several options from Python, and compare their records.

Run it from the folder above: ``python examples/fly_from_python.py``, or cell by cell in an editor
that knows ``# %%`` (VS Code, Spyder, Jupyter with jupytext). The records are left in ``runs/``.
"""

# %% Load a mission, with a value changed as `--set` changes it
from pathlib import Path

import numpy as np

from star_core import Registry, fly, load

MISSIONS = Path(__file__).parents[1] / "missions"
registry = Registry()
mission = load(MISSIONS / "first_flight.yaml", registry, ["swarm.cf1.start=[-1, -1, 0]"])
print(*mission.scene.names, "fly in", mission.scene.world.name)

# %% Fly it with several radii of the avoider; `fly` returns what summary.json keeps
summaries = {}
for radius in (0.2, 0.3):
    changes = [f"avoider.radius={radius}", "seed=3"]
    mission = load(MISSIONS / "first_flight.yaml", registry, changes)
    summaries[radius] = fly(mission, registry, folder=f"runs/radius-{radius}")

print("radius   closest approach   duration")
for radius, summary in summaries.items():
    closest, duration = summary["min_separation_m"], summary["flight_time_s"]
    print(f"{radius:4.1f} m   {closest:14.2f} m   {duration:6.1f} s")

# %% Plot or compute from the record: positions are (ticks, agents, axes), m
for radius in summaries:
    with np.load(f"runs/radius-{radius}/trajectory.npz") as record:
        error = record["estimate_position"] - record["truth_position"]
        names = record["agents"].tolist()
    rms = np.sqrt((error**2).sum(axis=2).mean(axis=0))  # of each agent
    print(f"{radius} m:", *(f"{name} {one:.3f} m" for name, one in zip(names, rms, strict=True)))
