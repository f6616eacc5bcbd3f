"""The picture of a ROS map: how light every pixel is, and which are transparent."""

from __future__ import annotations

import contextlib
import io
import os
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slam.formats.text import FormatError

if TYPE_CHECKING:
    from PIL import Image

MAX_PIXELS = 100_000_000
"""Larger images are refused, before they are decoded."""
BYTES_PER_PIXEL = 5
"""What reading takes: the file, the pixels, their shade, and two cells."""
FORMATS = ("PNG", "BMP", "JPEG", "TIFF", "PPM")
"""Pillow's names of what is read; most pgm and ppm by OpenCV, which is quicker."""
EXPECTED, TORN = "expected pgm, png, bmp, jpg or tif", "a torn image, expected a complete one"
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_GAP = rb"(?:\s|#[^\n]*\n)+"
_PNM = re.compile(rb"P([2356])" + _GAP + _GAP.join([rb"(\d{1,9})"] * 3) + rb"\s")
"""Of pgm and ppm: kind, width, height and the value that is white."""


@dataclass(frozen=True)
class MapImage:
    """Pixels from the top row down: ``shade (H, W)`` from 0, black, to ``white``; ``opaque (H, W)`` or, where
    all are, None."""

    shade: np.ndarray
    white: int
    opaque: np.ndarray | None


def read(path: Path) -> MapImage:
    """Read a picture; the shade of a colour is the sum of its channels, alpha is none of them.

    Raises `FormatError` for what is no image of 8 or 16 bits, is torn, or has more than `MAX_PIXELS`.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", path) from None
    header = _PNM.match(data[:4096])
    pixels, white = _read_pnm(data, header, path) if header else _read_other(data, path)
    if pixels.ndim == 2:
        return MapImage(np.minimum(pixels, white), white, None)
    opaque = pixels[..., 3] == white if pixels.shape[2] == 4 else None
    colours = pixels[..., :3].sum(axis=2, dtype=np.uint32)
    return MapImage(np.minimum(colours, 3 * white), 3 * white, opaque)


def _check_size(width: int, height: int, path: Path) -> None:
    if width * height > MAX_PIXELS:
        need = BYTES_PER_PIXEL * width * height / 1e9
        message = f"{width} x {height} pixels would take {need:.1f} GB of memory"
        raise FormatError(f"{message}, expected at most {MAX_PIXELS:,} pixels", path)


def _read_pnm(data: bytes, header: re.Match[bytes], path: Path) -> tuple[np.ndarray, int]:
    """Pixels ``(H, W)`` or ``(H, W, 3)`` of a pgm or ppm and the value that is white in them."""
    import cv2

    kind, (width, height, white) = header[1], (int(group) for group in header.groups()[1:])
    _check_size(width, height, path)
    if kind in b"56" and header[0].endswith(b"\r") and b"\r\n" in header[0]:
        data = data[: header.end()] + data[header.end() + 1 :]  # of a header written in DOS: no pixel
    if kind in b"23":
        data += b"\n"  # without which OpenCV misses the last number
    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # a torn image is told in our own one line
    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    finally:
        logging.setLogLevel(level)
    if pixels is None:
        raise FormatError(TORN, path)
    stretched = kind in b"23" and pixels.dtype == np.uint8  # as OpenCV does with numbers of 8 bits
    return np.asarray(pixels), 255 if stretched else max(white, 1)


def _read_other(data: bytes, path: Path) -> tuple[np.ndarray, int]:
    """Pixels ``(H, W)``, ``(H, W, 3)`` or with alpha ``(H, W, 4)`` and the value that is white in them."""
    from PIL import Image

    if data.startswith(PNG_MAGIC) and len(data) >= 24:  # also of a torn one
        _check_size(int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big"), path)
    with warnings.catch_warnings(action="ignore"), _silent_libtiff():
        try:
            image = Image.open(io.BytesIO(data), formats=FORMATS)
        except Image.DecompressionBombError:
            raise FormatError(f"too many pixels, expected at most {MAX_PIXELS:,}", path) from None
        except Exception:  # readers of torn headers raise what they like
            raise FormatError(f"not an image, {EXPECTED}", path) from None
        _check_size(*image.size, path)
        if image.mode == "F":
            raise FormatError("pixels are real numbers, expected 8 or 16 bits", path)
        try:
            if image.mode.startswith("I"):
                return np.asarray(image).astype(np.uint16), 65535
            return np.asarray(image.convert(_channels(image))), 255
        except Exception:
            raise FormatError(TORN, path) from None


def _channels(image: Image.Image) -> str:
    """Pillow's name of the channels that a picture of 8 bits is read as."""
    if "A" in image.mode or "transparency" in image.info:
        return "RGBA"
    return "L" if image.mode in ("1", "L") else "RGB"


@contextlib.contextmanager
def _silent_libtiff() -> Iterator[None]:
    """What C libraries print of torn images goes nowhere: they are told in our own one line."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no stderr
        yield
        return
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
