"""Small files in other projects' formats."""

import numpy as np


def ply(points: np.ndarray, form: str) -> bytes:
    """A .ply file of a structured array of float32, with a face after the vertices."""
    fields = "".join(f"property float {name}\n" for name in points.dtype.names)
    head = f"ply\nformat {form} 1.0\ncomment made\nelement vertex {len(points)}\n{fields}"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    if form == "ascii":
        rows = "".join(" ".join(map(repr, map(float, row))) + "\n" for row in points.tolist())
        return f"{head}{rows}3 0 1 2\n".encode()
    order = ">" if form == "binary_big_endian" else "<"
    body = points.astype([(name, f"{order}f4") for name in points.dtype.names]).tobytes()
    return head.encode() + body + b"\x03" + np.arange(3, dtype=f"{order}i4").tobytes()
