"""Plant the mistakes of `tests/mutants.toml` one at a time; print which the tests notice.

Exits with 1 if the tests notice fewer than 90 % of them.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
LEAST = 0.9  # fraction of the mutants that the tests have to notice


def main() -> int:
    """Return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="mutants with this text in name or file")
    only = parser.parse_args().only
    mutants = tomllib.loads((ROOT / "tests/mutants.toml").read_text())["mutant"]
    mutants = [mutant for mutant in mutants if only in mutant["name"] or only in mutant["file"]]
    noticed = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, stdout=-1).stdout
        subprocess.run(["tar", "-x"], cwd=tree, input=archive, check=True)
        for mutant in mutants:
            killer = plant(tree, mutant)
            noticed += killer is not None
            print(f"{mutant['file']}: {mutant['name']}: {killer or 'SURVIVED'}", flush=True)
    print(f"{noticed} of {len(mutants)} noticed")
    return int(noticed < LEAST * len(mutants))


def plant(tree: Path, mutant: dict[str, Any]) -> str | None:
    """Return the test that fails with a mutant planted in a tree, or None; remove it again."""
    file = tree / mutant["file"]
    code = file.read_text()
    if code.count(mutant["old"]) != 1:
        sys.exit(f"{mutant['name']}: `old` is not exactly once in {mutant['file']}")
    file.write_text(code.replace(mutant["old"], mutant["new"]))
    packages = [str(tree), *(str(path) for path in (tree / "plugins").iterdir() if path.is_dir())]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(packages)}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "-p", "no:cacheprovider"]
    command += ["-m", "not campaign"]
    try:
        run = subprocess.run(
            [*command, *mutant["tests"]],
            cwd=tree,
            env=environment,
            check=False,
            text=True,
            stdout=subprocess.PIPE,
        )
    finally:
        file.write_text(code)
    if run.returncode not in {0, 1}:
        sys.exit(f"{mutant['name']}: the tests did not run:\n{run.stdout}")
    failed = [line for line in run.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0].split(" - ")[0] if failed else None


if __name__ == "__main__":
    sys.exit(main())
