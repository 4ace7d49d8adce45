"""How long a report takes to write and to open, and how large it is.

Three drones with cameras fly for two minutes, and their images are saved. ``--study`` reports on
10,000 runs of invented measures instead: 100 conditions of two factors with 100 seeds. Opening is
the wall time until the first figure is shown, and until all are, in headless Chromium with a
software renderer: ``pip install playwright``, and Chromium by ``playwright install chromium`` or
that of the system.
"""

from __future__ import annotations

import json
import resource
import shutil
import statistics
import subprocess
import sys
import time
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from printed import command_line, show

ROOT = Path(__file__).parents[1]
STAR = Path(sys.executable).with_name("star")
FLIGHT = ["run", str(ROOT / "missions" / "three_eyes.yaml"), "--set", "mission.1.follow.laps=5"]
RENDERER = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
MEASURES = (
    *("collisions.agent_agent", "min_separation_m", "path_length_m.total", "flight_time_s"),
    *("position_mse_m2.mean", "position_worst_m"),
)
STUDY_RUNS = 10_000
GOALS = {"megabytes": 5.0, "write_s": 5.0, "open_s": 3.0, "requests": 0.0}


def written(folder: Path, rounds: int) -> dict[str, float]:
    """Return the median time of writing, s, its mean processor time, s, and the size, MB."""
    times = []
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    for _ in range(rounds):
        begun = time.perf_counter()
        subprocess.run([STAR, "report", folder], check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - begun)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    size = (folder / "report.html").stat().st_size
    return {
        "write_s": statistics.median(times),
        "write_cpu_s": spent / rounds,
        "megabytes": size / 1e6,
    }


def opened(page: Path, rounds: int) -> dict[str, float]:
    """Return median times until one figure and all figures are drawn, s, and further requests."""
    from playwright.sync_api import sync_playwright

    requests: list[str] = []
    times: dict[str, list[float]] = {"open_s": [], "all_s": []}
    with sync_playwright() as play:
        path = shutil.which("chromium")
        browser = play.chromium.launch(args=[*RENDERER, "--no-sandbox"], executable_path=path)
        for _ in range(rounds):
            tab = browser.new_page()
            tab.on("request", lambda request: requests.append(request.url))
            begun = time.perf_counter()
            tab.goto(page.as_uri())
            for name, mark in (("open_s", "begun"), ("all_s", "ready")):
                tab.wait_for_function(f"document.body.dataset.{mark} === 'true'")
                times[name].append(time.perf_counter() - begun)
            tab.close()
        browser.close()
    further = [url for url in requests if url != page.as_uri() and not url.startswith("data:")]
    medians = {name: statistics.median(taken) for name, taken in times.items()}
    return {**medians, "requests": float(len(further))}


def flown(folder: Path) -> dict[str, float]:
    """Fly three drones into a folder; return how long, and how many images they took."""
    command = [str(STAR), *FLIGHT, "--save-frames", "--out", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    flight = json.loads((folder / "summary.json").read_text())
    images = float(len(list(folder.glob("frames/*/*.png"))))
    return {"flight_s": flight["flight_time_s"], "images": images}


def invented(folder: Path) -> dict[str, float]:
    """Write the results of a study into a folder, and return how many runs and conditions."""
    rng = np.random.default_rng(0)
    conditions = list(product((f"avoider {a}" for a in range(10)), (f"{b} m" for b in range(10))))
    lines = ["mission,avoider,radius,seed,outcome,reason," + ",".join(MEASURES)]
    for (avoider, radius), seed in product(conditions, range(STUDY_RUNS // len(conditions))):
        collisions = int(rng.poisson(0.3))
        values = [f"{collisions}", *(repr(float(value)) for value in rng.lognormal(0, 1, 5))]
        outcome = "failed,1 collision" if collisions else "completed,"
        lines.append(",".join(["swap", avoider, radius, str(seed), outcome, *values]))
    folder.mkdir()
    (folder / "results.csv").write_text("\n".join(lines) + "\n")
    return {"runs": float(len(lines) - 1), "conditions": float(len(conditions))}


def main() -> None:
    """Print the figures."""
    arguments = command_line(__doc__, rounds=5)
    arguments.add_argument("--study", action="store_true")
    options = arguments.parse_args()
    with TemporaryDirectory() as home:
        folder = Path(home, "run")
        figures = {
            **(invented if options.study else flown)(folder),
            **written(folder, options.rounds),
            **opened((folder / "report.html").resolve(), options.rounds),
        }
    show(figures, as_json=options.json, goals=GOALS)


if __name__ == "__main__":
    main()
