"""A study that is killed and resumed equals an uninterrupted one, and flies every run once.

``python -m tests.campaign.killed_studies`` prints a line; the exit status is 1 if they differ.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from tests.plugins.commands.star_ablate.conftest import MISSION, WORLD

ABLATE: Final = (sys.executable, str(Path(sys.executable).with_name("star")), "ablate")
POLL_INTERVAL: Final = 0.05  # s
STUDY = """\
star: 1
name: killed
missions: [hop.yaml]
seeds: %d
factors: {rate: {slow: {rate: 10}, fast: {rate: 20}}}
measures: [path_length_m.total, flight_time_s, position_rmse_m]
"""


def study_of(folder: Path, runs: int) -> Path:
    """Write a study of short flights into a folder, and return its file."""
    (folder / "room.yaml").write_text(WORLD)
    (folder / "hop.yaml").write_text(MISSION)
    path = folder / "killed.yaml"
    path.write_text(STUDY % (runs // 2))
    return path


def journal(out: Path) -> list[str]:
    """Return the keys of the runs in a journal, without a line that was being written."""
    file = out / "runs.jsonl"
    keys = []
    for line in file.read_text().splitlines():
        try:
            keys.append(json.loads(line)["key"])
        except ValueError:
            continue
    return keys


def lines(out: Path) -> int:
    """Return the number of lines of a journal."""
    file = out / "runs.jsonl"
    return file.read_bytes().count(b"\n") if file.exists() else 0


def fly(study: Path, out: Path, options: Sequence[str] = (), kills: Sequence[int] = ()) -> None:
    """Fly a study; kill it by SIGKILL when its journal has a number of runs, and resume it."""
    command = [*ABLATE, str(study), "--out", str(out), "--quiet", *options]
    log = out.with_suffix(".log")
    for count in kills:
        with log.open("ab") as output, subprocess.Popen(command, stderr=output) as process:
            while process.poll() is None and lines(out) < count:
                time.sleep(POLL_INTERVAL)
            process.kill()
    with log.open("ab") as output:
        subprocess.run(command, stderr=output, check=True)


def compare(runs: int, kills: Sequence[int], options: Sequence[str] = ()) -> str:
    """Fly a study uninterrupted and killed; return what differs, or an empty text."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        study = study_of(folder, runs)
        fly(study, folder / "whole", options)
        fly(study, folder / "killed", options, kills)
        tables = [(folder / each / "results.csv").read_bytes() for each in ("whole", "killed")]
        flown = Counter(journal(folder / "killed"))
    if tables[0] != tables[1]:
        return "the tables differ"
    if tables[0].count(b"completed") != runs:
        return "not all runs were completed"
    if len(flown) != runs or set(flown.values()) != {1}:
        return f"of {runs} runs, {len(flown)} are in the journal, up to {max(flown.values())} times"
    return ""


def main() -> int:
    """Print one line."""
    line = argparse.ArgumentParser(description=__doc__)
    line.add_argument("--runs", type=int, default=1000)
    line.add_argument("--kills", type=int, default=5)
    options = line.parse_args()
    kills = [(k + 1) * options.runs // (options.kills + 1) for k in range(options.kills)]
    before = os.times()
    wrong = compare(options.runs, kills)
    spent = sum(os.times()[:4]) - sum(before[:4])
    print(
        f"{options.runs} runs, killed by SIGKILL {options.kills} times and resumed: "
        + (wrong or "results.csv is that of the uninterrupted study, and each run was flown once")
        + f" ({spent:.0f} s of processor time for both studies)"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
