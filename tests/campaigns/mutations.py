"""Damage to files, words and numbers, drawn from a random generator."""

import numpy as np

NASTY_WORDS = (
    "",
    "0",
    "-1",
    "-1e-3",
    "-y,x,z",
    "a\nb",
    "nan",
    "-inf",
    "1e308",
    "1e-300",
    "1e999",
    "2147483648",
    "9223372036854775808",
    "1" * 5000,
    "0x10",
    "1_0",
    "1.5",
    "Car",
    "\u0663",
    "\x00",
    "..",
    "[[[[",
)
NASTY_NUMBERS = (0.0, -1.0, np.nan, np.inf, -np.inf, 1e30, -1e30, 1e-40, 1e9, 500.0)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """`data` after one to three random changes of its bytes or words."""
    for _ in range(rng.integers(1, 4)):
        data = CHANGES[rng.integers(len(CHANGES))](data, rng)
    return data


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: rng.integers(0, len(data) + 1)]


def _insert(data: bytes, rng: np.random.Generator) -> bytes:
    at = rng.integers(0, len(data) + 1)
    return data[:at] + rng.bytes(rng.integers(1, 12)) + data[at:]


def _remove(data: bytes, rng: np.random.Generator) -> bytes:
    at = rng.integers(0, len(data) + 1)
    return data[:at] + data[at + rng.integers(1, 20) :]


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for at in rng.integers(0, max(len(data), 1), min(len(data), 4)):
        changed[at] ^= 1 << rng.integers(8)
    return bytes(changed)


def _repeat(data: bytes, rng: np.random.Generator) -> bytes:
    at, to = sorted(rng.integers(0, len(data) + 1, 2).tolist())
    return data[:to] + data[at:]


def _word(data: bytes, rng: np.random.Generator) -> bytes:
    separator = (b" ", b",", b"\n", b'"')[rng.integers(4)]
    words = data.split(separator)
    words[rng.integers(len(words))] = nasty_word(rng).encode()
    return separator.join(words)


CHANGES = (_cut, _insert, _remove, _flip, _repeat, _word, _word)


def nasty_word(rng: np.random.Generator) -> str:
    """A word that number parsers may stumble over."""
    return NASTY_WORDS[rng.integers(len(NASTY_WORDS))]


def damaged_points(rng: np.random.Generator, most: int = 300) -> np.ndarray:
    """(n, 3 to 5) float32 or float64 points, a few of them impossible."""
    count, width = rng.integers(0, most), rng.integers(3, 6)
    points = rng.uniform(-40, 40, (count, width)) * 10.0 ** rng.integers(-3, 3)
    for _ in range(rng.integers(0, 6) if count else 0):
        at = rng.integers(0, count), rng.integers(0, width)
        points[at] = NASTY_NUMBERS[rng.integers(len(NASTY_NUMBERS))]
    return points.astype(rng.choice([np.float32, np.float64]))
