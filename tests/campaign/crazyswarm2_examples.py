"""Whether the examples of Crazyswarm2 that need no ROS run unmodified by ``star script``.

The examples are Crazyswarm2's and not part of the project: the environment variable
`CRAZYSWARM2_EXAMPLES` names their folder, ``crazyflie_examples/crazyflie_examples`` of its
repository. They are copied, and each runs twice with two drones: in the simulator, and by the
transport `radio` with a fleet of its own. One has run if its flight completes without a collision,
it printed no failure, and its drones have flown unless it is none of `STAY`; one is stopped if its
drones would collide, as those of `COLLIDE` do, and its lines are named.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.campaign.example_scripts import Result, Run, campaign, output_of

FOLDER = "CRAZYSWARM2_EXAMPLES"
ELSEWHERE = {
    "infinite_flight.py",  # needs a charging pad, and has no end
    "simple_mapper_multiranger.py",  # these two need ROS
    "vel_mux.py",
}
STAY = {"arming.py", "set_param.py"}  # whose drones do not fly
COLLIDE = {"swap.py"}  # whose drones pass 0.1 m above each other
STOPPED = re.compile(r"\w+\.py:\d+ and \w+\.py:\d+: .* would be [\d.]+ m apart at [\d.]+ s")
FAILURE = re.compile(r"Traceback|is not disabled")
SWARM = """\
fileversion: 3
robots:
  cf5: {enabled: true, uri: radio://0/80/2M/E7E7E7E705, initial_position: [0, -1, 0], type: cf21}
  cf231: {enabled: true, uri: radio://0/80/2M/E7E7E7E7E7, initial_position: [0, 1, 0], type: cf21}
robot_types:
  cf21: {motion_capture: {enabled: false}, big_quad: false}
all:
  firmware_params: {stabilizer: {estimator: 2, controller: 2}}
"""


def main() -> int:
    """Run all; return 1 unless each runs, or is stopped if its drones would collide."""
    results, _complete = campaign(__doc__ or "", FOLDER, examples, run, prepare=prepare)
    expected = ("stopped" if Path(each.name).name in COLLIDE else "runs" for each in results)
    return int(any(r.outcome != e for r, e in zip(results, expected, strict=True)))


def prepare(root: Path) -> None:
    """Write the swarm."""
    (root / "crazyflies.yaml").write_text(SWARM)


def examples(folder: Path) -> Iterator[str]:
    """Yield the names of all examples, in the simulator and over a fleet."""
    names = {path.name for path in folder.glob("*.py")} - ELSEWHERE - {"__init__.py"}
    for transport in ("sim", "radio"):
        yield from (f"{transport}/{name}" for name in sorted(names))


def run(root: Path, name: str) -> Result:
    """Run an example, and judge it."""
    transport, _, script = name.partition("/")
    star, swarm = str(Path(sys.executable).parent / "star"), str(root / "crazyflies.yaml")
    folder = root / transport  # for the output, which is written beside the script
    folder.mkdir(exist_ok=True)
    command = [star, "script", str(root / "examples" / script), "--swarm", swarm]
    command += ["--no-record", "--json"]
    if transport == "radio":
        command = [star, "fleet", swarm, "--port", "0", "--", *command]
    failure, text = output_of(command, folder / script, Run())
    begin = text.find("{\n")
    if begin < 0:
        return Result(name, "fails", failure or "it printed no summary", text)
    summary = json.JSONDecoder().raw_decode(text[begin:])[0]
    if stopped := STOPPED.match(summary["reason"]):
        return Result(name, "stopped", stopped[0], text)
    reason = failure or summary["reason"]
    if match := FAILURE.search(text):
        reason = match[0]
    elif any(summary["collisions"].values()):
        reason = f"collisions: {summary['collisions']}"
    elif script not in STAY and not summary["path_length_m"]["total"]:
        reason = "no drone has flown"
    return Result(name, "fails" if reason else "runs", reason, text)


if __name__ == "__main__":
    sys.exit(main())
