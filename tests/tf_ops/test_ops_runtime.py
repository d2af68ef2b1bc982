"""The ops in graphs, input pipelines and threads; instruction sets; loading the library."""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from helpers import ops_reference as reference

import tf_ops
from tf_ops import loading
from tf_ops.normalization import batch_norm_relu, batch_norm_relu_max

ROOT = Path(tf_ops.__file__).resolve().parent.parent
BATCH, POINTS, SAMPLES = 3, 400, 60


def pyramid(xyz: tf.Tensor) -> dict[str, tf.Tensor]:
    """Every op, those on features by way of `features`."""
    chosen = tf_ops.farthest_point_sample(SAMPLES, xyz)
    sampled = tf_ops.gather_point(xyz, chosen)
    ball, count = tf_ops.query_ball_point(0.8, 8, xyz, sampled)
    few2, few = tf_ops.knn_point(8, sampled, xyz)
    many2, many = tf_ops.knn_point(40, sampled, xyz)
    three2, three = tf_ops.three_nn(xyz, sampled)
    moved = features(xyz, chosen, ball, three, three2)
    boxes = tf.concat([sampled, tf.abs(sampled), sampled[..., :1]], -1)
    iou = tf_ops.box_iou_3d(boxes, boxes)
    names = "chosen sampled ball count few2 few many2 many three2 three"
    values = [chosen, sampled, ball, count, few2, few, many2, many, three2, three]
    found = dict(zip(names.split(), values, strict=True))
    return found | moved | {"iou": iou}


def features(xyz, chosen, ball, three, weight) -> dict[str, tf.Tensor]:
    """Every op that moves or normalises features, and all their gradients together."""
    xyz, ones, zeros = tf.convert_to_tensor(xyz), tf.ones(3), tf.zeros(3)
    with tf.GradientTape() as tape:
        tape.watch([xyz, weight, ones])
        grouped = tf_ops.group_point(xyz, ball)
        dense = tf_ops.three_interpolate(tf_ops.gather_point(xyz, chosen), three, weight)
        rows = batch_norm_relu(tf.reshape(dense, [-1, 3]), ones, zeros, 1e-3)[0]
        pooled = batch_norm_relu_max(tf.reshape(grouped, [-1, 8, 3]), ones, zeros, 1e-3)[0]
        total = tf.reduce_sum(rows**2) + tf.reduce_sum(pooled**2)
    d_xyz, d_weight, d_ones = tape.gradient(total, [xyz, weight, ones])
    slopes = {"d_xyz": d_xyz, "d_weight": d_weight, "d_ones": d_ones}
    return {"grouped": grouped, "dense": dense, "rows": rows, "pooled": pooled} | slopes


def assert_same(a, b):
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_graph_with_unknown_batch_and_size():
    xyz = reference.cloud("random", BATCH, POINTS)
    traced = tf.function(
        pyramid, input_signature=[tf.TensorSpec((None, None, 3), tf.float32)], autograph=False
    )
    shapes = {
        name: t.shape.as_list()
        for name, t in traced.get_concrete_function().structured_outputs.items()
    }
    assert shapes["chosen"] == [None, SAMPLES]
    assert shapes["sampled"] == [None, SAMPLES, 3]
    assert shapes["ball"] == [None, SAMPLES, 8] and shapes["count"] == [None, SAMPLES]
    assert shapes["few"] == shapes["few2"] == [None, None, 8]
    assert shapes["three"] == shapes["dense"] == [None, None, 3]
    assert shapes["grouped"] == [None, SAMPLES, 8, 3]
    assert shapes["iou"] == [None, SAMPLES, SAMPLES]
    assert shapes["rows"] == shapes["pooled"] == [None, 3]
    assert shapes["d_xyz"] == [None, None, 3]
    assert_same(traced(xyz), pyramid(xyz))


def test_unknown_rank_and_gradient_in_a_graph():
    @tf.function(input_signature=[tf.TensorSpec(None), tf.TensorSpec(None, tf.int32)])
    def slope(points, index):
        with tf.GradientTape() as tape:
            tape.watch(points)
            total = tf.reduce_sum(tf_ops.group_point(points, index) ** 2)
        return tape.gradient(total, points)

    points = reference.cloud("random", 2, 5)
    index = np.array([[[0, 1]], [[4, 4]]], np.int32)
    expected = np.zeros_like(points)
    expected[0, :2], expected[1, 4] = 2 * points[0, :2], 4 * points[1, 4]
    np.testing.assert_allclose(slope(points, index), expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tf_ops.farthest_point_sample(3, tf.zeros((2, 5, 4))), "3"),
        (lambda: tf_ops.knn_point(3, tf.zeros((2, 5, 3)), tf.zeros((1, 5, 3))), "2 and 1"),
        (lambda: tf_ops.three_nn(tf.zeros((5, 3)), tf.zeros((5, 3))), "rank 3"),
    ],
)
def test_shape_functions_refuse_at_trace_time(call, message):
    with pytest.raises(ValueError, match=message):
        tf.function(call, autograph=False).get_concrete_function()


def test_parallel_map_of_a_dataset():
    clouds = np.concatenate([reference.cloud("random", 1, POINTS, seed) for seed in range(24)])
    mapped = tf.data.Dataset.from_tensor_slices(clouds).map(
        lambda xyz: pyramid(xyz[None]), num_parallel_calls=4, deterministic=True
    )
    for xyz, found in zip(clouds, mapped, strict=True):
        assert_same(found, pyramid(xyz[None]))


def test_several_python_threads_at_once():
    clouds = [reference.cloud("clustered", 2, POINTS, seed) for seed in range(4)]
    expected = [pyramid(xyz) for xyz in clouds]
    failures = []

    def work(i: int) -> None:
        try:
            for _ in range(8):
                assert_same(pyramid(clouds[i]), expected[i])
        except AssertionError as error:
            failures.append(error)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(len(clouds))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures


def test_index_ops_have_no_gradient():
    xyz = tf.constant(reference.cloud("random", 1, 20))
    with tf.GradientTape(persistent=True) as tape:
        tape.watch(xyz)
        dist2, _ = tf_ops.knn_point(3, xyz, xyz)
        three2, _ = tf_ops.three_nn(xyz, xyz)
    assert tape.gradient(dist2, xyz) is None
    assert tape.gradient(three2, xyz) is None


DUMP = """
import sys
import numpy as np
from helpers import ops_reference as reference
import test_ops_runtime as here
found = {}
for kind in reference.KINDS:
    for name, value in here.pyramid(reference.cloud(kind, 2, here.POINTS)).items():
        found[kind + name] = value.numpy()
np.savez(sys.argv[1], **found)
"""


@pytest.mark.slow
@pytest.mark.parametrize("instructions", ["portable", "avx2"])
def test_all_instruction_sets_agree_to_the_bit(instructions, tmp_path):
    """Kernels for older processors, run in their own process, give the same results."""
    tf_ops.load_library()
    if instructions not in loading.instruction_sets(loading.library_path()):
        pytest.skip(f"no {instructions}")
    folders = ROOT, ROOT / "tests", Path(__file__).parent
    path = os.pathsep.join(map(str, folders))
    environment = {**os.environ, "TF_OPS_INSTRUCTIONS": instructions, "PYTHONPATH": path}
    out = tmp_path / "found.npz"
    subprocess.run([sys.executable, "-c", DUMP, str(out)], env=environment, check=True)
    found = np.load(out)
    for kind in reference.KINDS:
        for name, value in pyramid(reference.cloud(kind, 2, POINTS)).items():
            np.testing.assert_array_equal(found[kind + name], value, err_msg=f"{kind} {name}")


@pytest.mark.parametrize("name", ["avx1024", "AVX2", ""])
def test_an_unknown_instruction_set_is_named(name, monkeypatch):
    tf_ops.load_library()
    path = loading.library_path()
    monkeypatch.setenv(loading.INSTRUCTIONS, "portable")
    loading.check_instructions(path)
    monkeypatch.setenv(loading.INSTRUCTIONS, name)
    message = rf"TF_OPS_INSTRUCTIONS: expected one of .*portable .* have\), found '{name}'"
    with pytest.raises(tf_ops.LibraryError, match=message):
        loading.check_instructions(path)
    with pytest.raises(tf_ops.LibraryError, match=message):
        loading._load.__wrapped__(path)  # again, as in a new process


def test_a_missing_library_names_the_command(tmp_path, monkeypatch):
    monkeypatch.setenv(loading.ENVIRONMENT, str(tmp_path / "libtf_ops.so"))
    with pytest.raises(tf_ops.LibraryError, match="is missing; run `make ops`"):
        tf_ops.load_library()


@pytest.mark.parametrize("record", ["", "[]", "{}"])
def test_an_unreadable_record_names_the_command(record, tmp_path):
    path = tmp_path / "libtf_ops.json"
    path.write_text(record)
    with pytest.raises(tf_ops.LibraryError, match="unreadable; run `make ops`"):
        loading.check_version(path)


MANY_THREADS = """
import sys

import numpy as np
import tensorflow as tf

import tf_ops

tf.config.threading.set_intra_op_parallelism_threads(int(sys.argv[1]))
cloud = np.random.default_rng(0).uniform(0, 9, (1, 2048, 3)).astype(np.float32)
sampled = tf_ops.farthest_point_sample(512, cloud)
ball, _ = tf_ops.query_ball_point(1.0, 32, cloud, cloud)
print(int(tf.reduce_sum(sampled)), int(tf.reduce_sum(ball)))
"""


def test_more_threads_than_leaves_of_a_tree():
    """The two samplings and searches of a single small cloud, with many threads."""
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", MANY_THREADS, str(threads)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        for threads in (1, 70)
    ]
    try:
        one, many = (run.communicate(timeout=120)[0] for run in runs)
    finally:
        for run in runs:
            run.kill()
    assert one == many != ""


def test_another_tensorflow_names_the_command(tmp_path):
    path = tmp_path / "libtf_ops.json"
    path.write_text(json.dumps({"tensorflow": "2.0.0"}))
    with pytest.raises(tf_ops.LibraryError, match=r"against TensorFlow 2\.0\.0.*run `make ops`"):
        loading.check_version(path)


def test_a_broken_library_names_the_command(tmp_path, monkeypatch):
    broken = tmp_path / "libtf_ops.so"
    broken.write_bytes(b"not a library")
    broken.with_suffix(".json").write_text(json.dumps({"tensorflow": tf.__version__}))
    monkeypatch.setenv(loading.ENVIRONMENT, str(broken))
    with pytest.raises(tf_ops.LibraryError, match="run `make clean-ops && make ops`"):
        tf_ops.load_library()
