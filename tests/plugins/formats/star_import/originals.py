"""Files in the original STAR's grammar, drawn from a seed: launch folders to import and to fly.

They have what its code accepts: names in any order, key points and absolute points, walls that
touch, cross and close, pairs of tags that overlap, tags and starts in obstacles, trailing commas,
comments, unknown keys, other files beside them, and words that are not ``wait``.
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Final

TASKS: Final = ("takeoff", "hold", "goto_velocity", "goto", "external", "land")
CORNERS: Final = ("top-left", "top-right", "bottom-right", "bottom-left")
NAMES: Final = ("cf1", "cf2", "cf5", "cf10", "cf13", "cf231", "drone_a", "B-7")


def launch_folder(folder: Path, seed: int) -> Path:
    """Write a launch folder with three missions and three environments, and return it."""
    draw = random.Random(seed)  # noqa: S311 -- not for secrets
    names = draw.sample(NAMES, draw.randint(1, 5))
    files = {
        "crazyflies.yaml": _robots(draw, names),
        "config.yaml": _config(draw, "room0.yaml"),
        "tags_36h11.yaml": "family: 36h11\nsize: 0.157\ndetector:\n  threads: 1\n",
        "server.yaml": "/crazyflie_server:\n  ros__parameters:\n    sim:\n      backend: np\n",
        "motion_capture.yaml": (
            "/motion_capture_tracking:\n  ros__parameters:\n    type: optitrack\n"
            '    hostname: "10.0.0.1"\n    marker_configurations: {}\n'
        ),
        f"calibration/{names[0]}.yaml": CALIBRATION.format(names[0]),
        "app.launch.py": "# not read\n",
        "notes/other.yaml": "colour: blue\n",
    }
    files |= {f"mission/m{i}.yaml": _mission(draw, names) for i in range(3)}
    files |= {f"environment/room{i}.yaml": _environment(draw) for i in range(3)}
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


CALIBRATION: Final = """\
image_width: 324
image_height: 244
camera_name: {}
camera_matrix:
  rows: 3
  cols: 3
  data: [181.5, 0.000000, 170.25, 0.0, 180.75, 160.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [-0.07, -0.006, 0.0008, 0.0006, 0.0]}}
"""


def _robots(draw: random.Random, names: list[str]) -> str:
    places = [(x / 2, y / 2) for x in range(-3, 4) for y in range(-3, 4)]
    lines = ["fileversion: 2", "robots:"]
    for name, place in zip(names, draw.sample(places, len(names)), strict=True):
        x, y = (round(value + draw.uniform(-0.05, 0.05), 3) for value in place)
        lines += [
            f"  {name}:",
            "    enabled: true  # flies",
            f"    uri: radio://*/{draw.randint(0, 125)}/2M/E7E7E7E7{draw.randint(16, 99)}",
            f"    initial_position: [{x}, {y}, 0]",
            "    initial_quaternion: [0.0, 0.0, 0.0, 1.0]",
            "    type: cf21",
            f"    mission_capable: {draw.choice(('true', 'false'))}",
            f"    ip_add: 192.168.1.{draw.randint(2, 250)}",
        ]
    lines += ["  spare: {enabled: false, uri: x, initial_position: [0, 0, 0], type: cf21}"]
    lines += ["robot_types:", "  cf21:", "    motion_capture: {enabled: false}"]
    lines += ["    battery: {voltage_warning: 3.8, voltage_critical: 3.7}", "all:"]
    lines += ["  firmware_params:", "    stabilizer:", f"      controller: {draw.choice((1, 2))}"]
    return "\n".join(lines) + "\n"


def _config(draw: random.Random, environment: str) -> str:
    return (
        f'queue_size: 20\nenvironment_file: "{environment}"\nexternal_timeout: 0.5\n'
        f"offset_agents: [0.0, 0.0]\nobstacle_expansion_factor: {draw.choice((0.0, 1.0, 3.5))}\n"
        "trajectory_parameters:\n  max_velocity: 0.4\n  maximum_yaw_change: 12.0\n"
        "  takeoff_land_velocity: 0.4\n  takeoff_height: 0.8\n  planning_rate: 8.0\n"
        "  protected_zone: 0.2\n  height_range: [0.5, 2.0]\n"
        "april_tag_parameters:\n  camera_rotation: [0, 0.3826834, 0, 0.9238795]\n"
        f"  observation_threshold: {draw.choice((1.0, 1.82, 5.01))}\n"
        f"  center_origin: {draw.choice(('true', 'false'))}\n"
    )  # fmt: skip


def _environment(draw: random.Random) -> str:
    lines = []
    if draw.random() < 0.8:
        lines += ["environment:", "  obstacles:"]
        for i in range(draw.randint(1, 5)):
            offsets = draw.random() < 0.5
            points = _walk(draw, offsets=offsets)
            low, high = draw.choice(((0.0, 1.5), (0.0, 2.5), (0.0, 0.5), (1.5, 2.5)))
            lines += [
                f"    {draw.choice(('obs', 'wall', 'O'))}{i}:",
                f"      use_key_point: {str(offsets).lower()}",
                f"      height: [{low}, {high}]",
                f"      thickness: {draw.choice((0.1, 0.2, 0.8, 1.2))}",
                f"      points: [{', '.join(map(str, points))}{draw.choice(('', ','))} ]",
            ]
    ids = iter(draw.sample(range(500), 40))
    near = draw.choice((0.2, 0.122))
    lines += ["april_tags:", f"  pair_position: [-0.12, -0.11, -0.12, {-0.11 - near:.4f}]"]
    lines += ["  pair_paper_size: [0.297, 0.420]", "  tags:"]
    for i in range(draw.randint(2, 9)):
        x, y = i % 3 * 1.5 - 2 + draw.choice((0, 0.2)), i // 3 * 1.5 - 2
        lines += [
            f"    id{next(ids):03} id{next(ids):03}:",
            f'      alignment: "{draw.choice(CORNERS)}"',
            f"      location: [{x:.3f}, {y}]",
            "      purpose: relocalization",
        ]
    for i in range(draw.randint(1, 4)):
        where = draw.choice(("0.0", f"{i * 0.9 - 1.1:.2f}, {draw.uniform(-2, 2):.3f}", "2.5, 0,0"))
        number = next(ids)
        lines += [f"    id{number:03}:", f"      id: {number}", f"      location: [{where}]"]
        lines += [f"      purpose: {draw.choice(('eliminate', 'eliminate', 'other'))}"]
    return "\n".join(lines) + "\n"


def _walk(draw: random.Random, *, offsets: bool) -> list[float]:
    x, y = draw.choice((-2.5, -1, 0.25, 1, 2.5)), draw.choice((-2.5, -1.25, 0.75, 2.25))
    numbers = [x, y]
    for _ in range(draw.randint(1, 4)):
        dx, dy = draw.choice(((1.0, 0.0), (0.0, -1.5), (-0.9, -0.0), (0.7, 0.7), (0.0, 0.9)))
        x, y = x + dx, y + dy
        numbers += [dx, dy] if offsets else [x, y]
    if offsets and draw.random() < 0.3:
        numbers += [round(numbers[0] - x, 6), round(numbers[1] - y, 6)]
    return [round(number, 6) for number in numbers]


def _mission(draw: random.Random, names: list[str]) -> str:
    records = ['"takeoff", "wait", "all", "", ""']
    for _ in range(draw.randint(0, 3)):
        some = " ".join(draw.sample(names, draw.randint(1, len(names))))
        who, word = draw.choice(("all", some)), draw.choice(("wait", "wait", "wait", "conc"))
        x, y = (round(draw.uniform(-2, 2), 2) for _ in "xy")
        z = draw.choice(("0.8", "1.0", "1.50"))
        goal = f"{x} {y} {z} {draw.choice(('0', '0.707', '-90'))}"
        records.append(draw.choice((
            f'"hold", "wait", "{who}", "0.5", ""',
            f'"goto_velocity", "{word}", "{who}", "", "{goal}"',
            f'"goto_velocity", "wait", "{some}", "", " {goal} "',
            f'"goto", "wait", "{who}", "", "{goal}"',
            f'"external", "wait", "{who}", "", ""',
            '"", "", "", "", ""',
        )))  # fmt: skip
    records.append(f'"land", "{draw.choice(("wait", "conc"))}", "all", "", ""')
    return "command_sequence: [\n  " + ",\n  ".join(records) + f"{draw.choice(('', ','))}\n]\n"
