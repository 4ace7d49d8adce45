"""``star calibrate camera`` calibrates a lens by images, or reports why it cannot."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import pytest
from ruamel.yaml import YAML

from star_calibrate import command as calibration
from star_calibrate.board import Board, View, Views, find_views
from star_calibrate.command import as_lines, as_text
from star_calibrate.lens import Lens, deviations, solve
from star_core import Camera, InputError, Registry, fly, load
from star_core.commands import main as cli
from tests.commands import Printed, command

main = command("calibrate")

Take: TypeAlias = Callable[[int, float], list[str]]

BOARD = Board(9, 6, 0.025)
TRUE = Camera()


@pytest.fixture(scope="module", autouse=True)
def _calibrated_once() -> Iterator[None]:
    """Have commands with the same images search them for boards, and solve for a lens, once."""
    lenses: dict[int, Lens] = {}  # by the `id` of the views, which `find` keeps

    @cache
    def find(images: tuple[str, ...], board: Board, pixels: str) -> Views:
        return find_views(images, board, pixels)

    def find_all(images: Sequence[str], board: Board, pixels: str) -> Views:
        return find(tuple(images), board, pixels)

    def solved(views: Views, board: Board) -> Lens:
        if id(views) not in lenses:
            lenses[id(views)] = solve(views, board)
        return lenses[id(views)]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "find_views", find_all)
        patch.setattr(calibration, "solve", solved)
        yield


@pytest.fixture(scope="module")
def views(shots: list[str]) -> Views:
    in_images: Views = vars(calibration)["find_views"](shots, BOARD, "gray")
    return in_images


@pytest.fixture(scope="module")
def lens(views: Views) -> Lens:
    solved: Lens = vars(calibration)["solve"](views, BOARD)
    return solved


def refused(arguments: Sequence[str]) -> str:
    with pytest.raises(InputError) as caught:
        main(["camera", *arguments])
    return str(caught.value)


def blank(path: Path, width: int = 324, height: int = 244) -> str:
    assert cv2.imwrite(str(path), np.full((height, width), 90, np.uint8))
    return str(path)


# The lens


def test_corners_are_found_where_they_are(studio: Any) -> None:
    rng = np.random.default_rng(5)
    off = []
    for _ in range(8):
        turn, place = studio.pose(rng)
        corners = BOARD.find(studio.picture(turn, place, rng))
        if corners is not None:
            true = studio.corners(turn, place)
            off.append(min(np.abs(c - true).mean() for c in (corners, corners[::-1])))
    assert len(off) >= 6
    assert np.median(off) < 0.1


def test_the_matrix_is_recovered(lens: Lens) -> None:
    off = np.subtract(lens.matrix, TRUE.matrix)
    assert np.abs(off).max() < 1.0
    assert (np.abs(off) < 5 * np.array(lens.deviation)).all()


def test_the_lens_bends_as_it_does(lens: Lens, studio: Any) -> None:
    """Wherever there were corners, points come to lie within half a pixel of where they should."""
    fx, fy, cx, cy = lens.matrix
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    x, y = np.meshgrid(np.linspace(-0.8, 0.7, 20), np.linspace(-0.8, 0.4, 20))
    points = np.stack([x, y, 1 + 0 * x], axis=-1).reshape(-1, 3)
    still = np.zeros(3)
    mine = cv2.projectPoints(points, still, still, matrix, np.array(lens.distortion))[0]
    true = cv2.projectPoints(points, still, still, studio.matrix, studio.bend)[0]
    assert np.linalg.norm(mine - true, axis=2).max() < 0.5


def test_the_error_is_that_of_the_corners(lens: Lens) -> None:
    assert 0.02 < lens.error < 0.2
    assert lens.error == pytest.approx(np.sqrt(np.mean([s.error**2 for s in lens.used])), rel=0.01)


def test_the_distance_of_the_board_follows_from_its_squares(views: Views, lens: Lens) -> None:
    assert all(0.15 < fit.distance < 0.45 for fit in lens.used)
    twice = solve(views, BOARD._replace(square=0.05))
    for fit, larger in zip(lens.used, twice.used, strict=True):
        assert larger.distance == pytest.approx(2 * fit.distance, rel=1e-3)


def test_a_picture_whose_corners_are_wrong_is_rejected_and_named(views: Views, lens: Lens) -> None:
    moved = views.with_board[0].corners + 8 * np.sin(views.with_board[1].corners)
    bent = View("bent.png", moved.astype(np.float32))
    worse = solve(views._replace(with_board=(*views.with_board, bent)), BOARD)
    assert "bent.png" in {fit.name for fit in worse.rejected}
    assert worse.matrix == pytest.approx(lens.matrix, abs=0.5)
    report = as_text(worse, views._replace(with_board=(*views.with_board, bent)))
    assert "bent.png: rejected: " in report


def test_corners_in_the_middle_only_are_reported_as_insufficient(views: Views, lens: Lens) -> None:
    poor = lens._replace(covered=0.5)
    assert "no corner was" in as_text(poor, views)
    assert "no corner was" not in as_text(lens._replace(covered=0.9), views)


def test_deviations_are_those_of_the_whole_least_squares_problem(studio: Any) -> None:
    rng = np.random.default_rng(3)
    poses = [studio.pose(rng) for _ in range(4)]
    places = [(cv2.Rodrigues(turn)[0], place) for turn, place in poses]
    lens = (studio.matrix, studio.bend)
    per_view = [cv2.projectPoints(studio.points, *place, *lens)[1] for place in places]
    whole = np.zeros((4 * 108, 4 * 6 + 8))
    for i, by in enumerate(per_view):
        rows = slice(108 * i, 108 * (i + 1))
        whole[rows, 6 * i : 6 * i + 6] = by[:, :6]
        whole[rows, 24:] = by[:, 6:14]
    spread = np.diag(np.linalg.inv(whole.T @ whole))[24:28]
    variance = 4 * 54 * 0.1**2 / (4 * 108 - 32)
    computed = deviations(studio.points, places, *lens, 0.1)
    assert computed == pytest.approx(np.sqrt(variance * spread), rel=1e-4)


def test_one_frontal_image_leaves_infinite_deviations(studio: Any) -> None:
    places = [(np.zeros(3), np.array([-0.1, -0.06, 0.3]))]
    assert deviations(studio.points, places, studio.matrix, np.zeros(5), 0.1) == (np.inf,) * 4


# The command


def test_calibrated_lenses_fly_in_missions_that_name_the_file(
    shots: list[str],
    lens: Lens,
    missions: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Printed,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["camera", *shots, "-o", "cameras/deck.yaml"]) == 0
    first, second = capsys.readouterr().out.splitlines()[-2:]
    assert second == "  swarm: {cf1: {camera: deck, ...}}"
    mission = (missions / "three_eyes.yaml").read_text(encoding="utf-8")
    shutil.copytree(missions / "worlds", "worlds")
    whole = f"{first.strip()}\n{mission.replace('camera: aideck', 'camera: deck')}"
    Path("eyes.yaml").write_text(whole.partition("  - follow")[0] + "  - land: {}\n", "utf-8")
    assert cli.main(["check", "eyes.yaml"]) == 0
    changes = ["transport.camera.mode=geometric", "localizer.processes=0"]
    flown = load("eyes.yaml", Registry(), changes)
    for agent in flown.scene.agents:
        camera = agent.camera
        assert camera is not None
        assert (camera.width, camera.height) == (324, 244)
        assert camera.matrix == pytest.approx(lens.matrix, abs=0.006)
        assert camera.distortion == pytest.approx(lens.distortion, abs=6e-6)
    assert fly(flown, Registry())["outcome"] == "completed"


def test_mosaics_of_a_color_camera_give_the_same_lens(
    shots: list[str], lens: Lens, tmp_path: Path
) -> None:
    rows, columns = np.indices((TRUE.height, TRUE.width)) % 2
    response = np.array([0.6, 1.0, 1.0, 0.5])[2 * rows + columns]
    mosaics = []
    for shot in shots:
        gray = cv2.imread(shot, cv2.IMREAD_GRAYSCALE)
        assert gray is not None
        mosaics.append(str(tmp_path / Path(shot).name))
        assert cv2.imwrite(mosaics[-1], np.rint(gray * response).astype(np.uint8))
    out = tmp_path / "color.yaml"
    assert main(["camera", *mosaics, "--pixels", "bayer_rggb", "-o", str(out)]) == 0
    written = YAML(typ="safe").load(out)
    assert written["pixels"] == "bayer_rggb"
    assert written["matrix"] == pytest.approx(lens.matrix, abs=0.5)


def test_the_file_states_its_origin_and_error(shots: list[str], lens: Lens, tmp_path: Path) -> None:
    out = tmp_path / "deck.yaml"
    main(["camera", *shots, "-o", str(out)])
    text = out.read_text(encoding="utf-8")
    used = len(lens.used)
    assert text.startswith(f"# A camera, calibrated by {used} images of a chessboard: ")
    assert f" {lens.error:.3f} px RMS.\n" in text
    assert list(YAML(typ="safe").load(text)) == [
        *("star", "name", "width", "height", "matrix", "distortion")
    ]


@pytest.mark.parametrize(
    ("flags", "name"),
    [
        (["-o", "deck.yaml"], "deck"),
        (["-o", "deck.yaml", "--name", "mine"], "mine"),
        (["-o", "2.yaml"], "calibrated"),
    ],
)
def test_a_camera_is_called_as_its_file_unless_a_name_is_given(
    flags: list[str], name: str, shots: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    main(["camera", *shots, *flags])
    assert YAML(typ="safe").load(Path(flags[1]))["name"] == name


@pytest.mark.parametrize(
    ("out", "folder", "file"),
    [
        ("mine.yaml", ".", "mine.yaml"),
        ("cameras/mine.yaml", ".", "cameras/mine.yaml"),
        ("missions/cameras/mine.yaml", "missions", "cameras/mine.yaml"),
        ("../mine.yaml", "..", "mine.yaml"),
        ("/lab/cameras/mine.yaml", "/lab", "cameras/mine.yaml"),
    ],
)
def test_the_lines_for_a_mission_name_the_file_from_its_folder(
    out: str, folder: str, file: str
) -> None:
    message = as_lines("mine", Path(out)).splitlines()
    assert message[0] == f"to use it, add these two lines to a mission in {folder!r}:"
    assert message[1] == f"  cameras: {{mine: {{file: {file}}}}}"


def test_the_report_names_every_picture_and_its_error(
    shots: list[str], lens: Lens, tmp_path: Path, capsys: Printed
) -> None:
    empty = blank(tmp_path / "empty.png")
    main(["camera", *shots, empty, "--out", str(tmp_path / "camera.yaml")])
    out = capsys.readouterr().out
    for fit in lens.used:
        assert f"{fit.name}: {fit.error:.3f} px at {fit.distance:.2f} m\n" in out
    assert f"{empty}: no board\n" in out
    assert f"RMS {lens.error:.3f} px over {len(lens.used)} images\n" in out


def test_without_a_file_the_camera_alone_is_printed(shots: list[str], capsys: Printed) -> None:
    assert main(["camera", *shots]) == 0
    printed = capsys.readouterr()
    assert YAML(typ="safe").load(printed.out)["name"] == "calibrated"
    assert "RMS" in printed.err


# What is refused


def test_images_without_board_are_named_and_too_few_are_refused(
    shots: list[str], tmp_path: Path
) -> None:
    empty = blank(tmp_path / "empty.png")
    first, second = refused([*shots[:4], empty]).splitlines()
    assert first == f"{empty}: no board of 9x6 inner corners found [calibration-failed]"
    assert second.startswith("4 images with a board of 9x6 inner corners are too few")


def test_another_board_than_the_printed_one_is_not_found(shots: list[str]) -> None:
    assert "no board of 8x7 inner corners found" in refused([*shots[:3], "--board", "8x7"])


def test_frontal_images_do_not_determine_the_focal_length(take: Take) -> None:
    message = refused(take(8, 0.0))
    assert "the images do not determine the focal length" in message
    assert message.endswith("tilted by 30 to 45 degrees, to all sides [calibration-failed]")


def test_corners_that_no_lens_explains_are_refused(views: Views) -> None:
    rng = np.random.default_rng(0)
    shaken = tuple(
        View(v.name, v.corners + rng.normal(0, 3, v.corners.shape).astype(np.float32))
        for v in views.with_board
    )
    with pytest.raises(InputError, match=r"px RMS, expected at most 1 px; is the board flat"):
        solve(views._replace(with_board=shaken), BOARD)


def test_pictures_of_different_sizes_are_refused(shots: list[str], tmp_path: Path) -> None:
    other = blank(tmp_path / "other.png", 640, 480)
    problem = f"{other}: is 640x480 px, but {shots[0]} is 324x244 [wrong-image-size]"
    assert refused([shots[0], other]) == problem


def test_pictures_that_are_no_camera_s_are_refused(tmp_path: Path) -> None:
    tiny = blank(tmp_path / "tiny.png", 12, 40)
    expected = "is 12x40 px, expected 16 to 4096 px each way [wrong-image-size]"
    assert refused([tiny]) == f"{tiny}: {expected}"


@pytest.mark.parametrize("content", [b"", b"no picture", b"\x89PNG\r\n\x1a\n"])
def test_files_that_are_no_pictures_are_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(content)
    expected = "no image; expected PNG, JPEG, PGM, ... [unreadable-file]"
    assert refused([str(path)]) == f"{path}: {expected}"


def test_every_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    names = [str(tmp_path / "a.png"), str(tmp_path / "b.png")]
    assert refused(names) == "\n".join(
        f"{name}: cannot be read: No such file or directory [unreadable-file]" for name in names
    )


def test_a_picture_that_is_named_twice_is_refused(shots: list[str]) -> None:
    assert refused([shots[0], shots[1], shots[0]]) == (
        f"{shots[0]}: given twice [invalid-argument]"
    )


@pytest.mark.parametrize("board", ["9", "9x", "2x6", "9x6x3", "x", "9*6", "-9x6"])
def test_what_is_no_board_is_refused(board: str) -> None:
    assert refused(["a.png", f"--board={board}"]) == (
        f"--board {board!r}: expected inner corners as 9x6, at least 3 each way [invalid-argument]"
    )


@pytest.mark.parametrize("square", ["0", "-1", "nan", "inf", "25"])
def test_what_is_no_square_is_refused(square: str) -> None:
    assert refused(["a.png", f"--square={square}"]).startswith("--square ")


@pytest.mark.parametrize("name", ["", "all", "1st", "a b", "a:"])
def test_what_is_no_name_is_refused(name: str) -> None:
    assert refused(["a.png", f"--name={name}"]).startswith(f"--name {name!r}: expected a letter")


def test_a_file_that_cannot_be_written_is_named(shots: list[str], tmp_path: Path) -> None:
    message = refused([*shots, "-o", str(tmp_path)])
    assert message == f"--out {tmp_path}: cannot be written: Is a directory [unwritable-file]"


def test_a_file_that_holds_no_camera_is_not_written_over(shots: list[str], tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text("star: 1\nname: precious\nworld: hall.yaml\n")
    assert refused([*shots, "-o", str(mission)]) == (
        f"--out {mission}: it exists and is not a camera; name another file [unwritable-file]"
    )
    assert mission.read_text() == "star: 1\nname: precious\nworld: hall.yaml\n"


def test_a_camera_may_be_calibrated_again(shots: list[str], tmp_path: Path) -> None:
    out = tmp_path / "deck.yaml"
    for _time in range(2):
        assert main(["camera", *shots, "-o", str(out)]) == 0
