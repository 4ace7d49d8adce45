"""How a color sensor's mosaic should be read: corners and tags found, by way of making it gray.

Scenes of small tags (`small_tags`) are seen through a Bayer filter whose red and blue pixels
respond less than the green ones; on a colorful ground the colors vary by a quarter. ``gray`` is a
gray sensor; ``star`` is `star_core.toolkit.gray_from_mosaic`.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Callable

import cv2
import numpy as np
from printed import command_line, show
from small_tags import CONDITIONS, Sighting, ours, scene

from star_core import Camera, Image
from star_core.toolkit import gray_from_mosaic
from star_sim.camera_sim.sensor import color_response

NOISE = 3.0  # gray values, standard deviation
SIZE = (800, 532)  # px
PIXELS = "bayer_rggb"
GRAINS = (20, 80)  # px, of the colors of the ground
WAYS: dict[str, Callable[[Image], Image]] = {
    "as_it_is": lambda mosaic: mosaic,
    "opencv_gray": lambda mosaic: _image(cv2.cvtColor(mosaic, cv2.COLOR_BayerRGGB2GRAY)),
    "opencv_green": lambda mosaic: _image(cv2.cvtColor(mosaic, cv2.COLOR_BayerRGGB2BGR)[..., 1]),
    "star": lambda mosaic: gray_from_mosaic(mosaic, PIXELS),
}


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    options = command_line(__doc__, scenes=3, tags=25).parse_args()
    figures: dict[str, float] = {}
    for name, colors in (("neutral", 0.0), ("colorful", 0.25)):
        for condition in ("small", "small_slanted"):
            figures |= compare(f"{name}_{condition}", condition, colors, options)
    show(figures, as_json=options.json)


def compare(name: str, condition: str, colors: float, options: Namespace) -> dict[str, float]:
    """Return the share of tags found and the corners' RMS error, px, for each way."""
    camera = Camera(width=SIZE[0], height=SIZE[1], pixels=PIXELS)
    errors: dict[str, list[float]] = {way: [] for way in ("gray", *WAYS)}
    present = 0
    for k in range(options.scenes):
        rng = np.random.default_rng(k)
        still = CONDITIONS[condition]._replace(noise=0.0, jpeg=100)
        image, truth = scene(rng, still, options.tags, SIZE)
        present += len(truth)
        noise = rng.normal(0, NOISE, image.shape)
        light = image * _colors(rng, colors) * color_response(camera) + noise
        mosaic = _image(np.clip(np.rint(light), 0, 255))
        images = {"gray": _image(np.clip(np.rint(image + noise), 0, 255))}
        images |= {way: read(mosaic) for way, read in WAYS.items()}
        for way, gray in images.items():
            errors[way] += _errors(gray, truth)
    shares = {f"{name}_{way}_share_found": len(off) / present for way, off in errors.items()}
    rms = {
        f"{name}_{way}_corner_rms_px": math.sqrt(float(np.mean(np.square(off))))
        for way, off in errors.items()
    }
    return shares | rms


def _errors(image: Image, truth: list[Sighting]) -> list[float]:
    return [
        sighting.distance(tag) for sighting in ours(image) for tag in truth if sighting.same(tag)
    ]


def _colors(rng: np.random.Generator, spread: float) -> np.ndarray[tuple[int, ...], np.dtype]:
    """Return factors of the pixels of a mosaic, by smooth fields of red, green and blue."""
    fields = []
    for _ in range(3):
        waves = [
            cv2.resize(
                rng.normal(0, 1, (SIZE[1] // grain + 2, SIZE[0] // grain + 2)),
                SIZE,
                interpolation=cv2.INTER_CUBIC,
            )
            for grain in GRAINS
        ]
        fields.append(np.exp(spread * np.sum(waves, axis=0) / math.sqrt(len(GRAINS))))
    rows, columns = np.indices(fields[0].shape) % 2
    return np.asarray(np.choose(rows + columns, fields))  # red, green, green, blue


def _image(values: np.ndarray[tuple[int, ...], np.dtype]) -> Image:
    return np.ascontiguousarray(values, np.uint8)


if __name__ == "__main__":
    main()
