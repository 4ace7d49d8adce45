"""Whether the examples of cflib run unmodified over ``star fleet``.

The examples are cflib's and not part of the project: the environment variable `CFLIB_EXAMPLES`
names their folder, for instance ``examples`` of crazyflie-lib-python at the parent of 6e366ee, the
last commit that had all 63. They are copied, and each runs in its own folder against a fleet of
ten drones in a room with a pillar, by ``star fleet MISSION -- python EXAMPLE``. One has run if it
ends with status 0, or if it is endless has done so for its time and ends on Ctrl-C; if it printed
what shows that it has done its work; and if neither it nor a thread of it printed a traceback or
a failure.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.campaign.example_scripts import Result, Run, campaign, output_of

FOLDER = "CFLIB_EXAMPLES"
EXPECTED = 45  # examples that run; fewer are a failure
FAILURE = re.compile(
    r"Traceback(?!(.*\n)+?KeyboardInterrupt)|not (found )?in (the )?TOC|\bfailed\b|"
    r"Could ?n.?t connect|No LED ring|Error when|cannot be added",
    re.IGNORECASE,
)
DECKS = ("multi-ranger", "led-ring", "color-led-bottom")
MISSION = """\
star: 1
name: cflib-examples
world: room.yaml
rate: 20
limits: {speed: 1.0, acceleration: 3.0, height: [0.2, 2.5]}
swarm:
%s
transport: sim
localizer: flow
planner: straight
avoider: none
mission: [takeoff: {height: 0.5}, land: {}]
"""
ROOM = """\
star: 1
name: cflib-examples
fence: {low: [-3.5, -3.5, 0], high: [3.5, 3.5, 2.8]}
obstacles:
  walls:
    polyline: [[3.2, -3.2], [3.2, 3.2], [-3.2, 3.2], [-3.2, -3.2], [3.2, -3.2]]
    thickness: 0.1
    height: [0, 2.8]
"""
LIGHTHOUSE = """\
calibs: {}
geos:
  0:
    origin: [-1.9, 1.9, 2.2]
    rotation: [[0.6, -0.7, 0.4], [0.7, 0.7, 0.0], [-0.3, 0.3, 0.9]]
systemType: 2
type: lighthouse_system_configuration
version: '1'
"""
PARAMETERS = """\
params:
  ring.effect:
    default_value: 6
    is_stored: true
    stored_value: 9
type: persistent_param_state
version: '1'
"""
FILES = {"lighthouse/lighthouse.yaml": LIGHTHOUSE, "parameters/parameters.yaml": PARAMETERS}


ONLY_ELSEWHERE = {
    "aideck/fpv.py": "a window (PyQt6)",
    "lighthouse/lighthouse_config_visualization.py": "no drone: it plots a file",
    "lighthouse/lighthouse_openvr_grab.py": "an OpenVR tracker",
    "lighthouse/lighthouse_openvr_grab_color.py": "an OpenVR tracker",
    "lighthouse/lighthouse_openvr_multigrab.py": "an OpenVR tracker",
    "lighthouse/multi_bs_geometry_estimation.py": "sweeps of real base stations, and a keyboard",
    "loco_nodes/lps_reboot_to_bootloader.py": "Loco anchors",
    "mocap/mocap_hl_commander.py": "a Vicon server",
    "mocap/mocap_swarm.py": "a Vicon server",
    "mocap/mocap_swarm_multi_commander.py": "a Vicon server",
    "mocap/qualisys_hl_commander.py": "a Qualisys server",
    "multiranger/multiranger_pointcloud.py": "a window (PyQt and vispy)",
    "radio/radio_test.py": "a Crazyradio of its own",
}
"""What examples need that a fleet is not."""

NOT_SERVED = {"memory/read_paa3905.py": "the raw image of the flow sensor"}
"""What examples need that a fleet does not serve."""

NO_EXAMPLES = {"multiranger/wall_following/wall_following.py"}  # a module of another one

RUNS = {
    "cfbridge.py": Run(endless=5, shows="Connected to"),
    "color_led_deck/color_led_cycle.py": Run(endless=5, shows="Cycling"),
    "color_led_deck/color_led_set.py": Run(endless=5, shows="Setting LED"),
    "console/console.py": Run(endless=5, shows="up and running"),
    "generic_led_deck/led_cycle.py": Run(endless=5, shows="Cycling"),
    "lighthouse/lighthouse_mass_upload.py": Run(shows="Success"),
    "lighthouse/read_lighthouse_mem.py": Run(shows="Geometry for base station"),
    "lighthouse/write_lighthouse_mem.py": Run(shows="Data written\nData written"),
    "link_quality/latency.py": Run(endless=5, shows="atency"),
    "memory/flash_memory.py": Run(keys="1\n\n\ny\n", shows="has been written"),
    "memory/read_deck_mem.py": Run(shows="Deck id|No memories to read"),
    "memory/read_l5.py": Run(shows="FPS"),
    "memory/read_ow.py": Run(shows="Valid     : True"),
    "memory/write_ow.py": Run(shows="Hello deck"),
    "multiranger/multiranger_push.py": Run(endless=20),
    "multiranger/multiranger_wall_following.py": Run(endless=30, shows="velocity_x"),
    "parameters/persistent_params_from_file.py": Run(("-f", "parameters.yaml")),
    "positioning/matrix_light_printer.py": Run(endless=30, shows=r"\[\d+, \d+, \d+\]"),
    "radio/scan.py": Run(shows="udp://|radio://"),
}


def main() -> int:
    """Run all; return 1 if fewer than `EXPECTED` run."""
    results, complete = campaign(__doc__ or "", FOLDER, examples, run, prepare=prepare)
    return int(complete and sum(result.outcome == "runs" for result in results) < EXPECTED)


def prepare(root: Path) -> None:
    """Write the mission of the fleet, and files that examples read."""
    for path, text in FILES.items():
        (root / "examples" / path).write_text(text)
    starts = [f"  cf{i}: {{start: [{i % 4 - 1.5}, {i // 4 - 1.0}, 0.0]}}" for i in range(10)]
    (root / "mission.yaml").write_text(MISSION % "\n".join(starts))
    (root / "room.yaml").write_text(ROOM)


def examples(folder: Path) -> Iterator[str]:
    """Yield the paths of all examples in a folder, relative to it."""
    for path in sorted(folder.rglob("*.py")):
        name = path.relative_to(folder).as_posix()
        if name not in NO_EXAMPLES:
            yield name


def run(root: Path, name: str) -> Result:
    """Run an example against a fleet of its own, and judge it."""
    if name in ONLY_ELSEWHERE:
        return Result(name, "elsewhere", f"needs {ONLY_ELSEWHERE[name]}")
    if name in NOT_SERVED:
        return Result(name, "fails", f"needs {NOT_SERVED[name]}, which is not served")
    case = RUNS.get(name, Run())
    script = root / "examples" / name
    port = "19850" if name == "radio/scan.py" else "0"
    decks = [word for deck in DECKS for word in ("--deck", deck)]
    command = [
        *(str(Path(sys.executable).parent / "star"), "fleet", str(root / "mission.yaml")),
        *("--port", port, *decks, "--", sys.executable, "-u", script.name, *case.arguments),
    ]
    reason, text = output_of(command, script, case)
    if not reason and (failure := FAILURE.search(text)):
        line = text[text.rfind("\n", 0, failure.start()) + 1 :].splitlines()
        last = [each for each in text.splitlines() if re.match(r"\w+(Error|Exception)\b", each)]
        reason = last[-1] if last else line[0]
    if not reason and not re.search(case.shows, text):
        reason = f"its output has no {case.shows!r}"
    return Result(name, "fails" if reason else "runs", reason, text)


if __name__ == "__main__":
    sys.exit(main())
