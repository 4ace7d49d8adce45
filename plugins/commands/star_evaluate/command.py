"""Command line of ``star evaluate``."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from star_core import InputError, Registry, Run, read_run
from star_core.toolkit import Progress, ReportTable, print_table

if TYPE_CHECKING:
    from star_evaluate.evaluation import Errors, Evaluation

COLUMNS = ("MSE m²", "RMS m", "worst m", "NEES", "flown m", "samples", "covered")


def run(options: argparse.Namespace, _registry: Registry) -> int:
    """Print the errors and return the exit status, 0.

    Raises:
        InputError: The record or the ground truth cannot be read, or they have no time in common.
    """
    from star_evaluate.evaluation import evaluate, recorded_truth
    from star_evaluate.truth_files import pairs, read_truth

    run = read_run(options.run, flown=True)
    with Progress(f"evaluating {options.run}"):
        if options.truth is None:
            tracks = recorded_truth(run)
            if not tracks:
                text = f"{options.run}: the record has no ground truth; name a file by --truth"
                raise InputError(text, "no-record")
        else:
            named = dict(pairs(options.body, run.agents))
            bodies = {name: name for name in run.agents} | named
            tracks = read_truth(Path(options.truth), bodies, options.topic)
            if absent := [body for name, body in named.items() if name not in tracks]:
                text = f"{options.truth}: no trajectory of {', '.join(absent)}"
                raise InputError(text, "no-record")
        offset = None if options.offset == "auto" else float(options.offset)
        evaluation = evaluate(run, tracks, offset=offset, align=options.align)
    source = options.truth or "ground truth of the record"
    if options.json:
        json.dump(_json(evaluation, source, options.align), sys.stdout, indent=2)
        sys.stdout.write("\n")
    else:
        sys.stdout.writelines(f"{line}\n" for line in _text(run, evaluation, source, options))
        print_table(_table(evaluation))
    return 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Compare a recorded flight with ground truth, from the end of each agent's take-off to the "
        "start of its landing: mean square error (± standard deviation over the ticks), RMS and "
        "worst distance in space, and NEES. Without --truth, with that of the record."
    )
    line.add_argument("run", help="folder of a run: runs/TIME-NAME")
    line.add_argument(
        "--truth",
        metavar="FILE",
        help="trajectories: .tum or .txt (TUM, of one agent), a folder of AGENT.tum, .csv with "
        "columns time,x,y,z and body if there are several, or .mcap",
    )
    line.add_argument(
        "--body",
        action="append",
        default=[],
        metavar="AGENT=BODY",
        help="name of an agent's body in the file, if not the agent's own; may be repeated",
    )
    line.add_argument(
        "--topic",
        default="/{}/ground_truth",
        metavar="TOPIC",
        help="topic of stamped poses in an .mcap file, {} for the body: %(default)s",
    )
    line.add_argument(
        "--offset",
        type=_offset,
        default="0",
        metavar="S|auto",
        help="seconds to add to the times of the ground truth; auto finds them by the speeds of "
        "both, and states them (default: %(default)s)",
    )
    line.add_argument(
        "--align",
        choices=("none", "yaw", "rigid"),
        default="none",
        help="turn and move the ground truth to the least mean square error, the same for all "
        "agents, and state how: about the vertical, or about any axis (default: %(default)s)",
    )
    line.add_argument("--json", action="store_true", help="as JSON, in SI units")


def _text(
    run: Run, evaluation: Evaluation, source: str, options: argparse.Namespace
) -> Iterator[str]:
    from scipy.spatial.transform import Rotation

    localizer = run.manifest["plugins"]["localizer"]["name"]
    yield f"{run.summary['mission']}, located by {localizer}, against {source}"
    how = "found by the speeds" if options.offset == "auto" else "as given"
    yield f"time offset  {evaluation.offset:.4f} s, {how}"
    if options.align == "none":
        yield "alignment    none"
    else:
        yaw, pitch, roll = Rotation.from_matrix(evaluation.rotation).as_euler("ZYX", degrees=True)
        moved = ", ".join(f"{value:.4f}" for value in evaluation.translation.tolist())
        yield (
            f"alignment    {options.align}: turned by roll {roll:.3f}°, pitch {pitch:.3f}°, yaw "
            f"{yaw:.3f}°, then moved by [{moved}] m"
        )


def _table(evaluation: Evaluation) -> ReportTable:
    """Return the errors of each agent."""
    rows = [_row(name, errors) for name, errors in evaluation.agents.items()]
    if len(evaluation.agents) > 1:
        rows.append(_row("all", evaluation.every))
    return ReportTable("", "", ["agent"], [(name, "") for name in COLUMNS], rows)


def _row(name: str, errors: Errors) -> tuple[str, ...]:
    if not errors.samples:
        return name, *["-"] * 5, "0", "0 %"
    return (
        name,
        f"{errors.mse:.3g} ± {errors.mse_std:.3g}",
        f"{errors.rmse:.4f}",
        f"{errors.worst:.4f}",
        f"{errors.nees:.2f}",
        f"{errors.path_length:.2f}",
        f"{errors.samples}",
        f"{100 * errors.coverage:.0f} %",
    )


def _json(evaluation: Evaluation, source: str, align: str) -> dict[str, Any]:
    return {
        "truth": source,
        "offset_s": evaluation.offset,
        "align": align,
        "rotation": evaluation.rotation.tolist(),
        "translation_m": evaluation.translation.tolist(),
        "agents": {name: _named(errors) for name, errors in evaluation.agents.items()},
        "all": _named(evaluation.every),
    }


def _named(errors: Errors) -> dict[str, float | None]:
    """Return the measures with their units; None for those that are not known."""
    units = {
        "mse": "mse_m2", "mse_std": "mse_std_m2", "rmse": "rmse_m", "worst": "worst_m",
        "path_length": "path_length_m",
    }  # fmt: skip
    return {
        units.get(name, name): value if math.isfinite(value) else None
        for name, value in errors._asdict().items()
    }


def _offset(text: str) -> str:
    if text != "auto" and not math.isfinite(float(text)):
        raise ValueError(text)
    return text


_offset.__name__ = "number or auto"  # as argparse calls it
