"""Ways in which a file comes to harm."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

Mutation = Callable[[bytes, np.random.Generator], bytes]

NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[^\s,]+")
EXTREMES = (
    b"1e308", b"-1e308", b"1e30", b"1e400", b"1e-320", b"nan", b"inf", b"-inf", b"-1", b"0", b"-0.0", b"1e9",
    b"4294967295", b"9223372036854775808", b"99999999", b"9" * 5000, b"", b"true", b"null", b"1_0", b"0x10",
    b"\xc2\xb2", b"[]", b"{}", b'"1"', b".inf", b"1.#QNAN", b"2020-01-01",
)  # fmt: skip
"""What a number is replaced with."""
WORDS = (b"\xff" * 4, b"\xff" * 8, b"\xff\xff\xff\x7f", b"\0" * 4, b"\0\0\0\x80", b"\0\0\0\0\0\0\xf0\x7f")
"""The same, of binary numbers."""
NESTS = (b"[", b"{", b'{"a":', b"[[", b"(", b"- ", b"&a [*a,", b"<a>")
DEEP = (10, 1000, 100_000)
LONGEST = 200_000
"""Bytes that a repeated part may fill."""


def flip_bits(data: bytes, rng: np.random.Generator) -> bytes:
    """One bit, two or sixteen are wrong."""
    array = np.frombuffer(data, dtype=np.uint8).copy()
    for _ in range(rng.choice([1, 1, 2, 16])):
        array[rng.integers(len(array))] ^= 1 << rng.integers(8)
    return array.tobytes()


def truncate(data: bytes, rng: np.random.Generator) -> bytes:
    """The end is missing."""
    return data[: rng.integers(len(data))]


def remove(data: bytes, rng: np.random.Generator) -> bytes:
    """A part is missing."""
    start, stop = _part(data, rng)
    return data[:start] + data[stop:]


def repeat(data: bytes, rng: np.random.Generator) -> bytes:
    """A part is there several times."""
    start, stop = _part(data, rng)
    times = min(int(rng.choice([1, 2, 100])), LONGEST // max(stop - start, 1))
    return data[:stop] + times * data[start:stop] + data[stop:]


def insert_noise(data: bytes, rng: np.random.Generator) -> bytes:
    """Random bytes came in between."""
    at = int(rng.integers(len(data) + 1))
    return data[:at] + rng.bytes(int(rng.integers(1, 200))) + data[at:]


def swap_fields(data: bytes, rng: np.random.Generator) -> bytes:
    """Two words changed places."""
    words = list(WORD.finditer(data, 0, LONGEST))
    if len(words) < 2:
        return data[::-1]
    a, b = (words[k] for k in sorted(rng.choice(len(words), 2, replace=False)))
    return data[: a.start()] + b[0] + data[a.end() : b.start()] + a[0] + data[b.end() :]


def change_number(data: bytes, rng: np.random.Generator) -> bytes:
    """A number, or the bytes of one, became extreme."""
    numbers = list(NUMBER.finditer(data, 0, LONGEST))
    if numbers and (b"\0" not in data or rng.random() < 0.3):
        number = numbers[rng.integers(len(numbers))]
        return data[: number.start()] + EXTREMES[rng.integers(len(EXTREMES))] + data[number.end() :]
    word = WORDS[rng.integers(len(WORDS))]
    at = int(rng.integers(len(data)))
    return data[:at] + word + data[at + len(word) :]


def nest(data: bytes, rng: np.random.Generator) -> bytes:
    """Brackets open without end."""
    numbers = list(NUMBER.finditer(data, 0, LONGEST))
    at = numbers[rng.integers(len(numbers))].start() if numbers else int(rng.integers(len(data) + 1))
    return data[:at] + NESTS[rng.integers(len(NESTS))] * int(rng.choice(DEEP)) + data[at:]


MUTATIONS: dict[str, Mutation] = {
    "bits flipped": flip_bits,
    "cut off": truncate,
    "part missing": remove,
    "part repeated": repeat,
    "noise inserted": insert_noise,
    "fields swapped": swap_fields,
    "huge numbers": change_number,
    "deep nesting": nest,
}


def _part(data: bytes, rng: np.random.Generator) -> tuple[int, int]:
    start, stop = sorted(rng.integers(len(data) + 1, size=2).tolist())
    return (start, min(stop, start + 64)) if rng.random() < 0.5 else (start, stop)
