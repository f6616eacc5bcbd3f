"""What a file is that is no recording, and what can be done with it."""

from __future__ import annotations

import re

UNPACK = "unpack it and read the recording within"
CONVERT = "convert it to one of the formats that are read"
SIGNATURES: dict[bytes, tuple[str, str]] = {
    b"#ROSBAG V": (
        "a ROS 1 bag",
        "name it NAME.bag, or convert it: rosbags-convert --src NAME.bag --dst NAME",
    ),
    b"SQLite format 3\0": ("a SQLite database", "if it is a ROS 2 bag, name it NAME.db3"),
    b"\x89MCAP0\r\n": ("an MCAP file", "if it is a ROS 2 bag, name it NAME.mcap"),
    b"PK\x03\x04": ("a zip archive", UNPACK),
    b"PK\x05\x06": ("an empty zip archive", UNPACK),
    b"7z\xbc\xaf\x27\x1c": ("compressed with 7-Zip", UNPACK),
    b"Rar!": ("compressed with RAR", UNPACK),
    b"\x04\x22\x4d\x18": ("compressed with LZ4", UNPACK),
    b"LZIP": ("compressed with lzip", UNPACK),
    b"\x1f\x9d": ("compressed with compress", UNPACK),
    b"\x5d\0\0": ("compressed with LZMA", UNPACK),
    b"\x89PNG": ("a PNG image", "a map is read by the yaml beside it"),
    b"\xff\xd8\xff": ("a JPEG image", "a map is read by the yaml beside it"),
    b"GIF8": ("a GIF image", "a map is read by the yaml beside it"),
    b"BM": ("a BMP image", "a map is read by the yaml beside it"),
    b"II*\0": ("a TIFF image", "a map is read by the yaml beside it"),
    b"MM\0*": ("a TIFF image", "a map is read by the yaml beside it"),
    b"P5": ("a PGM image", "a map is read by the yaml beside it"),
    b"P2": ("a PGM image", "a map is read by the yaml beside it"),
    b"\x93NUMPY": ("a NumPy array", "slam.recording.Recording takes arrays, in Python"),
    b"\x89HDF": ("an HDF5 file", CONVERT),
    b"MATLAB 5.0": ("a MATLAB file", CONVERT),
    b"\x80\x04\x95": ("a Python pickle", CONVERT),
    b"# .PCD": ("a point cloud (PCD)", CONVERT),
    b"ply\n": ("a point cloud (PLY)", CONVERT),
    b"%PDF": ("a PDF document", CONVERT),
    b"\x7fELF": ("a program", CONVERT),
    b"MZ": ("a program", CONVERT),
    b"\n\r\r\n": ("a packet capture", CONVERT),
    b"\xd4\xc3\xb2\xa1": ("a packet capture", CONVERT),
}
"""First bytes → what such a file is, and what to do."""
TAR = 257, b"ustar"
"""Where a tar archive says that it is one."""
TEXTS: tuple[tuple[re.Pattern[bytes], str, str], ...] = (
    (
        re.compile(rb"^(VERTEX|EDGE)_\w+", re.M),
        "a pose graph (g2o)",
        "python -m scenarios.posegraph reads it",
    ),
    (re.compile(rb"^image:", re.M), "the yaml of a ROS map", "name it NAME.yaml"),
    (re.compile(rb"^rosbag2_bagfile_information:"), "a bag's metadata.yaml", "name the folder that it is in"),
    (re.compile(rb"\A\s*<(\?xml|!DOCTYPE|html)", re.I), "a web page or XML", "was the download complete?"),
    (re.compile(rb"\Aversion https://git-lfs"), "a pointer of Git LFS", "fetch the file: git lfs pull"),
    (re.compile(rb"\A\s*[{\[]"), "JSON", CONVERT),
)
"""The same of text files, by what is written in them."""


def describe(data: bytes) -> str | None:
    """``a PNG image: a map is read by the yaml beside it``, or None where nobody knows."""
    for magic, (kind, remedy) in SIGNATURES.items():
        if data.startswith(magic):
            return f"{kind}: {remedy}"
    offset, magic = TAR
    if data[offset : offset + len(magic)] == magic:
        return f"a tar archive: {UNPACK}"
    for pattern, kind, remedy in TEXTS:
        if pattern.search(data, 0, 10_000):
            return f"{kind}: {remedy}"
    return None
