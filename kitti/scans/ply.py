"""The vertices of a .ply file (Stanford polygon format, Greg Turk 1994), ascii or binary."""

import re

import numpy as np

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER = re.compile(rb"ply\r?\n.*?^end_header\r?\n", re.DOTALL | re.MULTILINE)
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
    form, elements = _elements(header[0].decode("ascii").splitlines())
    rest, lines = data[header.end() :], iter(())
    if form == "ascii":
        lines = iter(rest.decode("ascii").split("\n"))
    at = 0
    for name, count, properties in elements:
        if count > len(data):
            raise ValueError(f"{count} elements declared in {len(data)} bytes")
        if properties is None:
            raise ValueError(f"expected the vertices before the lists of element {name}")
        dtype = np.dtype([(key, _ORDERS[form] + kind) for key, kind in properties])
        if form == "ascii":
            found = _from_text([next(lines, "") for _ in range(count)], dtype)
        else:
            found = np.frombuffer(rest, dtype, count, at) if count else np.zeros(0, dtype)
        at += count * dtype.itemsize
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


def _from_text(lines: list[str], dtype: np.dtype) -> np.ndarray:
    words = [line.split() for line in lines]
    if any(len(row) != len(dtype.names) for row in words):
        raise ValueError(f"expected {len(lines)} lines of {len(dtype.names)} numbers")
    rows = np.array(words, np.float64).reshape(len(lines), len(dtype.names))
    found = np.zeros(len(lines), dtype)
    with np.errstate(all="ignore"):
        for name, column in zip(dtype.names, rows.T, strict=True):
            found[name] = column
    return found
