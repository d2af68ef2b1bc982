"""Reads NumPy's .npy format from bytes, without executing code or allocating undeclared memory."""

import io
import math

import numpy as np


def parse_npy(data: bytes) -> np.ndarray:
    """The array of an .npy file (version 1 or 2); a copy that may be written to.

    Raises:
        ValueError: another format, Python objects, or a declared size that differs from the data.
    """
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"expected .npy of version 1 or 2, found {version}")
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    try:
        shape, fortran_order, dtype = read_header(stream)
    except Exception as error:  # NumPy passes on what Python's parser raises
        raise ValueError(f"expected a header of .npy: {error}") from error
    if dtype.hasobject:
        raise ValueError(f"expected numbers, found Python objects ({dtype})")
    rest = len(data) - stream.tell()
    counts = all(type(side) is int and side >= 0 for side in shape)  # True is none
    if not counts or math.prod(shape) * dtype.itemsize != rest:
        raise ValueError(f"expected {rest} bytes, found shape {shape} of {dtype}")
    order = "F" if fortran_order else "C"
    return np.frombuffer(data, dtype, offset=stream.tell()).reshape(shape, order=order).copy()
