"""Compressed files: gzip, bzip2, xz and Zstandard, told by their first bytes."""

from __future__ import annotations

import io
import sys
import zlib
from importlib import import_module

ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
PACKINGS = {
    b"\x1f\x8b": ("gzip", "gzip", ""),
    b"BZh": ("bzip2", "bz2", ""),
    b"\xfd7zXZ\0": ("xz", "lzma", "LZMAError"),
    b"\x28\xb5\x2f\xfd": ("Zstandard", ZSTD, "ZstdError"),
}
"""First bytes → what it is called, the module whose ``open`` reads it, and that module's own error."""
SUFFIXES = (".gz", ".bz2", ".xz", ".zst")
TORN = (EOFError, OSError, ValueError, zlib.error)
MAX_BYTES = 500_000_000
"""A file that unpacks to more is refused before it fills the memory."""


def unpack(data: bytes) -> bytes:
    """The bytes, unpacked where they are compressed. Raises ``ValueError`` in one line where that fails."""
    for magic, (name, module, failure) in PACKINGS.items():
        if data.startswith(magic):
            packing = import_module(module)
            errors = (*TORN, getattr(packing, failure)) if failure else TORN
            try:
                with packing.open(io.BytesIO(data)) as stream:
                    content = stream.read(MAX_BYTES + 1)
            except errors as error:
                raise ValueError(f"torn {name} file ({error}), expected a complete one") from None
            if len(content) > MAX_BYTES:
                raise ValueError(f"compressed with {name}, more than {MAX_BYTES:,} bytes: unpack it first")
            return bytes(content)
    return data
