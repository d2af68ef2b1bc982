"""Calls that ended the process: shapes that no tensor can have, scalars, too little memory.

Each runs in another process, several in one, which prints the error that each raises.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import tf_ops

ROOT = Path(tf_ops.__file__).resolve().parent.parent

PRELUDE = """
import tensorflow as tf
import tf_ops

raw, zeros = tf_ops.load_library(), tf.zeros
def ints(*shape):
    return zeros(shape, tf.int32)
def attempt(name, call):
    try:
        call()
    except Exception as error:
        print(name, type(error).__name__, " ".join(str(error).split()), sep="|", flush=True)
"""

SHAPES = """
many = 2**31 - 1
attempt("samples", lambda: tf_ops.farthest_point_sample(3, zeros((2**62, 0, 3))))
attempt("weight", lambda: tf_ops.group_difference(
    zeros((1, 4, 0)), ints(1, 2, 3), zeros((1, 2, 0)), zeros((1, 2, 3, 0)), zeros((2**62, 0))))
attempt("query", lambda: tf_ops.group_difference(
    zeros((2**20, 0, 2**40)), ints(2**20, 2**40, 0), zeros((1, 2, 0)),
    zeros((2**20, 2**40, 0, 0)), zeros((0, 2**40))))
attempt("grad", lambda: raw.point_track_net_group_point_grad(
    grad=zeros((0, 2**62)), index=ints(4, 4), size=4))
attempt("rows", lambda: raw.point_track_net_group_point_grad(
    grad=zeros((2**40, 0, 2**20)), index=ints(2**40, 0), size=many))
attempt("rank", lambda: tf_ops.group_point(zeros((1, 4, 2)), ints(*[1] * 254)))
attempt("rank in a graph", tf.function(
    lambda: tf_ops.group_point(zeros((1, 4, 2)), ints(*[1] * 254))))
"""

SCALARS = """
def traced(op, **inputs):
    return tf.function(lambda: op(**inputs), autograph=False).get_concrete_function
attempt("group_point", traced(
    raw.point_track_net_group_point_grad, grad=zeros(()), index=ints(), size=4))
norm = dict.fromkeys(("grad", "x", "gamma", "beta", "mean", "variance"), zeros(()))
attempt("batch_norm", traced(raw.point_track_net_batch_norm_relu_grad, epsilon=1e-3, **norm))
attempt("batch_norm_max", traced(
    raw.point_track_net_batch_norm_relu_max_grad, epsilon=1e-3, place=ints(), **norm))
"""

MEMORY = """
import resource
import numpy as np

def suppress(count):
    boxes = np.ones((count, 7), np.float32)
    boxes[:, 0] = 9 * np.arange(count)
    limits = {"vote_iou": 0.4, "nms_iou": 0.02, "max_boxes": count}
    return tf_ops.suppress_boxes(boxes, np.ones(count, np.float32), **limits)

suppress(10)
pages = int(open("/proc/self/statm").read().split()[0])
limit = pages * resource.getpagesize() + (100 << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
attempt("suppress", lambda: suppress(8000))  # of 256 MB
print("alive", len(suppress(10)[0]), "", sep="|")
"""


def errors_of(script: str) -> dict[str, tuple[str, str]]:
    """By name: the type and the message of the error of each attempt; the process ends well."""
    run = subprocess.run(
        [sys.executable, "-c", PRELUDE + script],
        cwd=ROOT,
        env={**os.environ, "TF_CPP_MIN_LOG_LEVEL": "3"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    rows = (line.split("|", 2) for line in run.stdout.splitlines())
    return {name: (kind, message) for name, kind, message in rows}


def test_shapes_that_no_tensor_can_have():
    found = errors_of(SHAPES)
    assert found.pop("rank in a graph")[0] == "ValueError"
    assert {kind for kind, _ in found.values()} == {"InvalidArgumentError"}
    assert "has no points to choose from" in found["samples"][1]
    assert "must have shape (B, N, C)" in found["weight"][1]
    assert "must have shape (B, N, C)" in found["query"][1]
    assert "grad must have shape (B, ..., C)" in found["grad"][1]
    assert "overflow" in found["rows"][1]
    assert "index has too many dimensions: 254" in found["rank"][1]


def test_scalars_in_a_graph():
    found = errors_of(SCALARS)
    assert found["group_point"] == ("ValueError", found["group_point"][1])
    assert "must be at least rank 3 but is rank 0" in found["group_point"][1]
    for name, rank in (("batch_norm", 2), ("batch_norm_max", 3)):
        assert found[name][0] == "ValueError"
        assert f"must be rank {rank} but is rank 0" in found[name][1]


@pytest.mark.skipif(
    sys.platform != "linux" or "asan" in os.environ.get("LD_PRELOAD", ""),
    reason="limits the memory by Linux's means; a sanitizer ends the process itself",
)
def test_suppression_without_memory():
    found = errors_of(MEMORY)
    assert found["suppress"][0] == "ResourceExhaustedError"
    assert "no memory to suppress 8000 boxes" in found["suppress"][1]
    assert found["alive"][0] == "10"
