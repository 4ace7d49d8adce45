"""Draw a run from above: where the agents were, and where they were believed to be.

``python benchmarks/top_view.py RUN... OUT.png``: a panel for each run folder. Needs matplotlib.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes


def main() -> None:
    """Write the picture."""
    *runs, out = sys.argv[1:]
    figure, axes = plt.subplots(1, len(runs), figsize=(5 * len(runs), 5.2), squeeze=False)
    for axis, run in zip(axes[0], runs, strict=True):
        draw(axis, Path(run))
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="lower center", ncols=2)
    figure.tight_layout(rect=(0.0, 0.06, 1.0, 1.0))
    figure.savefig(out, dpi=80)


def draw(axis: Axes, run: Path) -> None:
    """Draw one run into a panel."""
    manifest = json.loads((run / "manifest.json").read_text())
    summary = json.loads((run / "summary.json").read_text())
    for sheet in manifest["world"].get("landmarks", {}).values():
        axis.plot(*sheet["at"][:2], "ks", markersize=7, fillstyle="none")
    with np.load(run / "trajectory.npz") as flown:
        for i in range(len(flown["agents"])):
            x, y, _ = flown["truth_position"][:, i].T
            axis.plot(x, y, color="0.55", linewidth=2.5, label="truth" if i == 0 else None)
            x, y, _ = flown["estimate_position"][:, i].T
            axis.plot(x, y, "C3", linewidth=0.8, label="estimate" if i == 0 else None)
    mse = summary["position_mse_m2"]["mean"]
    localizer = manifest["plugins"]["localizer"]["name"]
    axis.set_title(f"{summary['mission']}, {localizer}: MSE {mse:.4f} m²")
    axis.set_aspect("equal")
    axis.set_xlabel("x, m")
    axis.set_ylabel("y, m")


if __name__ == "__main__":
    main()
