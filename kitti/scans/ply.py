"""The vertices of a .ply file (Stanford polygon format, Greg Turk 1994), ascii or binary."""

import re

import numpy as np

from kitti.scans.point_text import numbered_lines, parse_lines

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER = re.compile(
    rb"(?:\xef\xbb\xbf)?ply\s*\n.*?^end_header[ \t]*\r?\n", re.DOTALL | re.MULTILINE
)
_MAX_HEADER = 10_000  # bytes


def parse_ply(data: bytes) -> np.ndarray:
    """The element `vertex` as a structured array (n,), fields in file order.

    Elements before it must not contain lists; those after it (faces) are ignored.

    Raises:
        ValueError: another format, truncated, or more vertices declared than bytes.
    """
    header = _HEADER.match(data[:_MAX_HEADER])
    if header is None:
        raise ValueError("expected a header from ply to end_header")
    form, elements = _elements(header[0].decode("utf-8-sig", "replace").splitlines())
    lines, at = numbered_lines(data, header.end()) if form == "ascii" else iter(()), header.end()
    for name, count, properties in elements:
        if count > len(data):
            raise ValueError(f"{count} elements declared in {len(data)} bytes")
        if properties is None:
            where = "no lists in" if name == "vertex" else "the vertices before the lists of"
            raise ValueError(f"expected {where} element {name}")
        dtype = np.dtype([(key, _ORDERS[form] + kind) for key, kind in properties])
        if form == "ascii":
            found = parse_lines(lines, count, dtype)
        else:
            found = _binary(data, at, count, dtype)
            at += found.nbytes
        if name == "vertex":
            return found
    raise ValueError("expected an element vertex")


def _elements(header: list[str]) -> tuple[str, list[tuple[str, int, list | None]]]:
    """The format, and name, count and properties of each element; None for one with lists."""
    form, elements = "", []
    for words in (line.split() for line in header):
        match words:
            case [
                "format",
                ("ascii" | "binary_little_endian" | "binary_big_endian") as form,
                "1.0",
            ]:
                pass
            case ["element", name, count] if count.isascii() and count.isdigit():
                elements.append((name, int(count), []))
            case ["property", "list", *_] if elements:
                elements[-1] = (*elements[-1][:2], None)
            case ["property", kind, name] if elements and kind in _TYPES:
                if elements[-1][2] is not None:
                    elements[-1][2].append((name, _TYPES[kind]))
            case [] | ["ply"] | ["end_header"] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"unknown line in the header: {' '.join(words)}")
    if not form:
        raise ValueError("expected a format: ascii, binary_little_endian or binary_big_endian 1.0")
    return form, elements


def _binary(data: bytes, at: int, count: int, dtype: np.dtype) -> np.ndarray:
    whole = (len(data) - at) // max(dtype.itemsize, 1)
    if whole < count:
        raise ValueError(f"{count} points declared, {whole} found")
    return np.frombuffer(data, dtype, count, at) if count else np.zeros(0, dtype)
