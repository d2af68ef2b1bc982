"""Arrays in NumPy's format: faults of a file are one kind of error."""

import io

import numpy as np
import pytest

from common.npy import parse_npy


def _npy(header: str) -> bytes:
    """A file of version 1 with this header and 16 bytes of data."""
    return b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header.encode() + bytes(16)


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_come_back(order):
    array, file = np.asarray(np.arange(12.0).reshape(3, 4), order=order), io.BytesIO()
    np.save(file, array)
    again = parse_npy(file.getvalue())
    np.testing.assert_array_equal(again, array)
    assert again.flags.writeable


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f4', 'fortran_order': False, 'shape': (True, 4)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (-1, -4)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (5,)}",
        "{'descr': '<,4', 'fortran_order': False, 'shape': (4,)}",
        "{'descr': '|O', 'fortran_order': False, 'shape': (2,)}",
        "{'descr': '<f4', 'fortran_order': False, b'shape': (4,)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (4,",
        "-" * 9000 + "1",
        "{[]: 1}",
    ],
)
def test_every_fault_of_a_header_is_a_value_error(header):
    with pytest.raises(ValueError, match="expected "):
        parse_npy(_npy(header))
