"""The picture of a ROS map: how light every pixel is, and which are transparent."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slam.formats.text import FormatError

MAX_PIXELS = 100_000_000
"""Larger images are refused, before they are decoded."""
BYTES_PER_PIXEL = 5
"""What reading takes: the file, the pixels, their shade, and two cells."""
EXPECTED = "expected pgm, png, bmp, jpg or tif"
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
        data = np.fromfile(path, dtype=np.uint8)
        header = _PNM.match(data[:4096].tobytes())
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", path) from None
    width, height = (int(header[2]), int(header[3])) if header else _size(data[:24].tobytes(), path)
    if width * height > MAX_PIXELS:
        need = BYTES_PER_PIXEL * width * height / 1e9
        message = f"{width} x {height} pixels would take {need:.1f} GB of memory"
        raise FormatError(f"{message}, expected at most {MAX_PIXELS:,} pixels", path)
    if header and header[1] in b"56" and header[0].endswith(b"\r") and b"\r\n" in header[0]:
        data = np.delete(data, header.end())  # the line feed of a header written in DOS, which is no pixel
    if data[:2].tobytes() in (b"P1", b"P2", b"P3"):
        data = np.append(data, np.uint8(ord("\n")))  # OpenCV misses the last number of a text file without it
    pixels = _decoded(data, path)
    white, opaque = _white(header, pixels, path), None
    if pixels.ndim == 2:
        return MapImage(np.minimum(pixels, white), white, None)
    if pixels.shape[2] == 4:
        opaque, pixels = pixels[..., 3] == white, pixels[..., :3]
    most = white * pixels.shape[2]
    return MapImage(np.minimum(pixels.sum(axis=2, dtype=np.uint32), most), most, opaque)


def _size(head: bytes, path: Path) -> tuple[int, int]:
    """Width and height, without the pixels, of an image that begins with ``head``."""
    from PIL import Image

    if head.startswith(PNG_MAGIC) and len(head) == 24:
        return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:
            return image.size
    except Image.DecompressionBombError:
        raise FormatError(f"too many pixels, expected at most {MAX_PIXELS:,}", path) from None
    except Exception:  # readers of torn headers raise what they like
        raise FormatError(f"not an image, {EXPECTED}", path) from None


def _decoded(data: np.ndarray, path: Path) -> np.ndarray:
    """Pixels ``(H, W)`` or ``(H, W, channels)`` as they are in the file."""
    import cv2

    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # a torn image is told in our own one line
    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    finally:
        logging.setLogLevel(level)
    if pixels is None:
        raise FormatError("a torn image, expected a complete one", path)
    return np.asarray(pixels)


def _white(header: re.Match[bytes] | None, pixels: np.ndarray, path: Path) -> int:
    """The value of a channel that is white; OpenCV stretches those of an 8 bit text file to 255."""
    if pixels.dtype not in (np.uint8, np.uint16):
        raise FormatError(f"pixels are {pixels.dtype}, expected 8 or 16 bits", path)
    if header is None or (header[1] in b"23" and pixels.dtype == np.uint8):
        return int(np.iinfo(pixels.dtype).max)
    return max(int(header[4]), 1)
