"""Arrays and grey images as the page reads them: typed, little-endian, base64."""

from __future__ import annotations

import base64
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from slam.se2 import Array

Kind = Literal["f4", "i2", "u2", "u1"]
GAPS: dict[str, int] = {"i2": -32768, "u2": 65535, "u1": 255}
"""What stands for "nothing" where a type has no NaN."""


def pack(values: ArrayLike, kind: Kind = "f4", scale: float = 1.0) -> dict[str, object]:
    """Numbers as multiples of ``scale`` in the type ``kind``, clipped to its range.

    NaN and infinities become "nothing" (`GAPS`; in ``f4`` they stay what they are).
    """
    array = np.asarray(values, dtype=np.float64)
    if kind in GAPS:
        limits = np.iinfo(kind)
        low, high = (limits.min + 1, limits.max) if kind == "i2" else (limits.min, limits.max - 1)
        whole = np.clip(np.rint(np.where(np.isfinite(array), array / scale, 0.0)), low, high)
        array = np.where(np.isfinite(array), whole, GAPS[kind])
    data = np.ascontiguousarray(array, dtype=f"<{kind}").tobytes()
    return {"kind": kind, "scale": scale, "data": base64.b64encode(data).decode("ascii")}


def pack_share(values: Array) -> dict[str, object]:
    """Numbers from 0 to 1 in a byte each."""
    return pack(values, "u1", 1 / 254)


def pack_bits(flags: np.ndarray) -> dict[str, object]:
    """Flags ``(M, B)`` bool as bits: each row starts a byte, the first flag is its highest bit."""
    data = np.packbits(flags, axis=1)
    encoded = base64.b64encode(data.tobytes()).decode("ascii")
    return {"kind": "u1", "row": int(data.shape[1]), "data": encoded}


def data_address(png: bytes) -> str:
    """A PNG file as the address of an image."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def image(shades: np.ndarray, origin: Array, resolution: float) -> dict[str, object]:
    """Grey values ``(H, W)`` uint8 with row 0 at the bottom, and the corners of their place [m]."""
    import cv2

    ok, data = cv2.imencode(".png", shades[::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not ok:
        raise RuntimeError(f"OpenCV cannot encode an image of {shades.shape}")
    x, y = (round(float(value), 4) for value in origin)
    height, width = shades.shape
    corners = [x, y, round(x + width * resolution, 4), round(y + height * resolution, 4)]
    return {"image": data_address(data.tobytes()), "corners": corners}


def rounded(values: ArrayLike) -> list[float]:
    """Numbers to five decimals."""
    return [round(float(value), 5) for value in np.asarray(values)]
