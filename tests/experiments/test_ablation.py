"""Tables III and IV end to end on small networks: trained, interrupted, skipped, evaluated."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import two_cars
from helpers.config_flags import config_flags
from helpers.network_cases import SMALL_TRACKER
from helpers.small_weights import write_weights

from common import flags
from common.errors import InputError
from common.files import locked
from common.imports import imported_files
from common.provenance import ROOT, command
from experiments import table3, table4
from experiments.ablation import rows as ablation
from experiments.ablation.rows import DISTANCES, TABLE_FIELDS
from experiments.ablation.table import differences, draw, order_sentence
from models.config import TrackerConfig
from training.sampling.data import open_data

SHORT = ("epochs=1", "frames_per_epoch=2", "batch_size=1")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Sequences 0000 and 0001 with three frames each, and a small detector beside them."""
    folder = tmp_path_factory.mktemp("ablation")
    for seq in (0, 1):
        two_cars.write_sequence(folder, seq, frames=3)
    write_weights(folder / "weights")
    return folder


def arguments(root, out, *more) -> list[str]:
    words = ["--data_root", root, "--seqs", "0001", "--val_seqs", "0000"]
    words += ["--weights", root / "weights", "--workdir", out / "work"]
    words += ["--out", out / "tables", "--seeds", "2"]
    for pair in SHORT:
        name, value = pair.split("=")
        words += [f"--schedule.{name}", value]
    shared = {name: getattr(TrackerConfig(), name) for name in TABLE_FIELDS}
    small = dataclasses.replace(SMALL_TRACKER, **shared)
    return [str(word) for word in (*words, *config_flags(small, "tracker"), *more)]


def rows_of(table, *names):
    return dataclasses.replace(table, rows=tuple(r for r in table.rows if r.name in names))


@pytest.mark.slow
def test_tables_share_a_row_and_resume(root, tmp_path, monkeypatch):
    names = ("cosine distance", "no association")
    monkeypatch.setattr(table3, "FUSIONS", rows_of(table3.FUSIONS, *names))
    four = rows_of(table4.FEATURES, "DSA2 + DFP2", "Filter + FC1")
    monkeypatch.setattr(table4, "FEATURES", four)
    trained, train_row = [], ablation.train_row

    def train_and_note(own, folder, *more):
        trained.append((own.tracker.fusion, own.tracker.fused_features, own.schedule.seed))
        if len(trained) == 2:
            raise KeyboardInterrupt
        return train_row(own, folder, *more)

    monkeypatch.setattr(ablation, "train_row", train_and_note)
    commit = "first"
    monkeypatch.setattr(ablation, "git_commit", lambda: commit)
    argv = arguments(root, tmp_path)
    assert flags.run(table3.main, argv) == flags.INTERRUPTED
    assert not (tmp_path / "tables" / "table3.md").exists()
    pair = tmp_path / "work" / "pairs" / "filter+FC1" / "000000.npz"
    stored = pair.stat().st_mtime_ns
    commit = "second"
    assert flags.run(table3.main, argv) == 0
    cosine, none = ("cosine_distance", "filter+FC1"), ("none", "filter+FC1")
    assert trained == [(*cosine, 0), (*none, 0), (*none, 0), (*cosine, 1), (*none, 1)]

    table = json.loads((tmp_path / "tables" / "table3.json").read_text())
    assert table["run"]["row_commits"] == ["first", "second"]
    record = table["figures"]
    assert list(record["rows"]) == list(names)
    for settings in (run for runs in record["rows"].values() for run in runs):
        assert [(s["boxes"], s["displacement"]) for s in settings] == [
            (boxes, distance) for distance in DISTANCES for boxes in ("network", "gt")
        ]
        assert all(s["clear3d"]["GT"] == 2 * 3 for s in settings)  # two cars, three frames
        assert all(s["clear3d"]["FN"] == 0 for s in settings if s["boxes"] == "gt")
        assert all(s["end_point_error"] > 0 for s in settings)
    first, second = ([s["end_point_error"] for s in run] for run in record["rows"][names[0]])
    assert first != second  # another seed is another training
    text = " ".join((tmp_path / "tables" / "table3.md").read_text().split())
    assert f"Made by `{' '.join(command().split())}`" in text
    assert "| paper: cosine distance | 0.747 | 0.811 | 0.680 | 0.047 | - | - |" in text
    assert "## True boxes, D = 2 m" in text and "2 trainings of 1 x 2 pairs" in text
    assert (tmp_path / "tables" / "table3.png").read_bytes().startswith(b"\x89PNG")

    assert flags.run(table4.main, argv) == 0
    assert [t[1] for t in trained[5:]] == ["DSA2+DFP2"] * 2  # the other row is Table III's
    assert pair.stat().st_mtime_ns == stored
    rows = json.loads((tmp_path / "tables" / "table4.json").read_text())["figures"]["rows"]
    assert rows["Filter + FC1"] == record["rows"]["cosine distance"]
    with np.load(tmp_path / "work" / "pairs" / "DSA2+DFP2" / "000000.npz") as file:
        assert file["xyz"].shape[0] == 2 and file["features"].dtype == np.float16

    with pytest.raises(InputError, match="holds rows with another config"):
        table3.main([*argv, "--schedule.seed", "1"])


def settings_of(root, out):
    args = ablation.parse(table3.FUSIONS, "", arguments(root, out))
    return ablation.check_settings(args, ablation.default_config(), open_data(args))


def test_a_workdir_of_other_scans_or_code_is_refused(root, tmp_path, monkeypatch):
    first = settings_of(root, tmp_path)
    assert settings_of(root, tmp_path) == first
    scan = root / "training" / "velodyne" / "0001" / "000002.bin"
    content = scan.read_bytes()
    scan.write_bytes(content[16:])
    with pytest.raises(InputError, match="holds rows with another scans: another --workdir"):
        settings_of(root, tmp_path)
    scan.write_bytes(content)
    monkeypatch.setattr(ablation, "code_digest", lambda: b"other")
    with pytest.raises(InputError, match="holds rows with another code: another --workdir"):
        settings_of(root, tmp_path)


def test_the_digest_of_the_code_has_training_evaluation_and_metrics():
    names = {str(path.relative_to(ROOT)) for path in imported_files(*ablation.MODULES)}
    assert {"training/loop.py", "training/tracker_task.py", "metrics/clear3d.py"} <= names
    assert {"models/losses.py", "tracking/association_to_trajectory.py"} <= names
    assert all(path.is_file() for path in ablation.FILES)


def test_rows_of_another_process_come_last(tmp_path, monkeypatch):
    first, second = table4.FEATURES.rows[:2]
    args = SimpleNamespace(workdir=tmp_path, seeds=1)
    order, other = [], locked(ablation.row_folder(first, 0, args) / "lock")
    other.__enter__()

    def measure(row, *more):
        order.append(row)
        if row is second:
            other.__exit__(None, None, None)
        return [{"row": row.name}]

    monkeypatch.setattr(ablation, "measure_row", measure)
    table = rows_of(table4.FEATURES, first.name, second.name)
    found = ablation.measure_rows(table, args, None, None)
    assert order == [second, first]
    assert found == {row.name: [[{"row": row.name}]] for row in (first, second)}


def test_rows_are_the_papers_and_two_of_ours():
    for table, own in ((table3.FUSIONS, 2), (table4.FEATURES, 0)):
        assert [row.paper for row in table.rows if row.paper] == list(table.paper)
        assert len(table.rows) == len(table.paper) + own
        folders = [row.folder for row in table.rows]
        assert len(set(folders)) == len(folders) and "filter+FC1-cosine_distance" in folders


def motas(*values, boxes="network", distance=0.0):
    return [[{"boxes": boxes, "displacement": distance, "clear3d": {"MOTA": v}}] for v in values]


def test_differences_are_those_above_the_spread():
    figures = {"a": motas(0.7, 0.72), "b": motas(0.71, 0.73), "c": motas(0.5, 0.52)}
    found = differences(figures, ("network", 0.0))
    assert found.endswith("(2 of 3): a > c; b > c.")
    paper = {"a": (0.9,), "b": (0.8,), "c": (0.7,)}
    assert order_sentence(figures, paper).endswith("is a > b > c; at D = 0 m ours is b > a > c.")
    assert order_sentence(figures, {"b": (0.9,), "c": (0.1,)}).endswith("ours is the same.")


def test_without_a_labelled_vehicle_there_is_no_order(tmp_path):
    figures = {"a": motas(None, None), "b": motas(None, None)}
    assert differences(figures, ("network", 0.0)).endswith("(0 of 0): none.")
    paper = {"a": (0.9,), "b": (0.8,)}
    assert order_sentence(figures, paper).endswith("at D = 0 m ours is undefined.")
    draw(tmp_path / "a.png", "A", figures, paper)
    assert (tmp_path / "a.png").is_file()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--tracker.fusion", "concat"), "belongs to the rows of the tables"),
        (("--weights", "none"), "none/detector.npz: --weights: expected a checkpoint"),
        (("--seqs", "0000"), "--seqs: expected one, or one for each --data_root"),
    ],
)
def test_invalid_flags_are_named(root, tmp_path, more, message):
    with pytest.raises(InputError, match=message):
        table3.main(arguments(root, tmp_path, *more))
