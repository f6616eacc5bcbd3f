"""Arrays as the page reads them: typed, little-endian, base64."""

from __future__ import annotations

import base64
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

Kind = Literal["f4", "i2", "u2", "u1"]
GAPS: dict[str, int] = {"i2": -32768, "u2": 65535, "u1": 255}
"""What stands for "nothing" where a type has no NaN."""


def packed(values: ArrayLike, kind: Kind = "f4", scale: float = 1.0) -> dict[str, object]:
    """Numbers as multiples of ``scale`` in the type ``kind``; what does not fit is cut off at its ends.

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


def bits(flags: np.ndarray) -> dict[str, object]:
    """Flags ``(M, B)`` bool as bits: each row starts a byte, the first flag is its highest bit."""
    data = np.packbits(flags, axis=1)
    return {
        "kind": "u1",
        "row": int(data.shape[1]),
        "data": base64.b64encode(data.tobytes()).decode("ascii"),
    }


def picture(png: bytes) -> str:
    """A PNG file as the address of an image."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")
