"""Tables III and IV end to end on small networks: trained, interrupted, skipped, evaluated."""

import dataclasses
import json

import pytest
from helpers import two_cars
from helpers.config_flags import config_flags
from helpers.network_cases import SMALL_TRACKER
from helpers.small_weights import write_weights

from common import flags
from common.errors import InputError
from common.provenance import command
from experiments import ablation, table3, table4
from experiments.ablation import DISTANCES
from experiments.paper import ABLATION_COLUMNS
from models.config import TrackerConfig

SHORT = ("epochs=1", "frames_per_epoch=2", "batch_size=1", "validation_frames=1")


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
    words += ["--detector", root / "weights" / "detector.npz", "--workdir", out / "work"]
    words += ["--out", out / "tables", "--score_threshold", "0"]
    for pair in SHORT:
        name, value = pair.split("=")
        words += [f"--schedule.{name}", value]
    small = dataclasses.replace(
        SMALL_TRACKER,
        fusion=TrackerConfig().fusion,
        fused_features=TrackerConfig().fused_features,
    )
    return [str(word) for word in (*words, *config_flags(small, "tracker"), *more)]


def rows_of(table, *names):
    return dataclasses.replace(table, rows={name: table.rows[name] for name in names})


@pytest.mark.slow
def test_table3_goes_on_where_it_was_interrupted(root, tmp_path, monkeypatch):
    names = ("elementwise product", "cosine distance")
    monkeypatch.setattr(table3, "FUSIONS", rows_of(table3.FUSIONS, *names))
    trained, train = [], ablation.train

    def train_and_note(row, task, config):
        trained.append((config.tracker.fusion, row.resume))
        if len(trained) == 2:
            raise KeyboardInterrupt
        return train(row, task, config)

    monkeypatch.setattr(ablation, "train", train_and_note)
    argv = arguments(root, tmp_path)
    assert flags.run(table3.main, argv) == flags.INTERRUPTED
    assert not (tmp_path / "tables" / "table3.md").exists()
    assert flags.run(table3.main, argv) == 0
    assert [name for name, _ in trained] == ["elementwise_product", *2 * ["cosine_distance"]]

    record = json.loads((tmp_path / "tables" / "table3.json").read_text())["figures"]
    assert list(record["rows"]) == list(names)
    for settings in record["rows"].values():
        assert [(s["boxes"], s["displacement"]) for s in settings] == [
            (boxes, distance) for distance in DISTANCES for boxes in ("network", "gt")
        ]
        assert all(s["clear3d"]["GT"] == 2 * 3 for s in settings)  # two cars, three frames
        assert all(s["clear3d"]["FN"] == 0 for s in settings if s["boxes"] == "gt")
        assert all(s["end_point_error"] > 0 for s in settings)
    text = " ".join((tmp_path / "tables" / "table3.md").read_text().split())
    assert f"Made by `{' '.join(command().split())}`" in text
    assert "| paper: cosine distance | 0.747 | 0.811 | 0.680 | 0.047 |" in text
    assert "| true boxes, 2 m |" in text and "1 epochs of 2 pairs, seed 0" in text

    (tmp_path / "work" / "cosine_distance" / "weights" / "tracker.npz").unlink()
    assert flags.run(table3.main, argv) == 0  # killed between the last step and the export
    assert len(trained) == 3
    assert json.loads((tmp_path / "tables" / "table3.json").read_text())["figures"] == record

    with pytest.raises(InputError, match="holds rows with another config"):
        table3.main([*argv, "--schedule.seed", "1"])


@pytest.mark.slow
def test_table4_trains_a_row(root, tmp_path, monkeypatch):
    name = "DSA2 + DFP2"
    monkeypatch.setattr(table4, "FEATURES", rows_of(table4.FEATURES, name))
    assert flags.run(table4.main, arguments(root, tmp_path)) == 0
    text = (tmp_path / "tables" / "table4.md").read_text()
    assert text.count(name) == 3  # ours, the paper's, and the second table's
    config = json.loads((tmp_path / "work" / "DSA2+DFP2" / "training" / "config.json").read_text())
    assert config["config"]["tracker"]["fused_features"] == "DSA2+DFP2"


def test_rows_are_the_papers():
    for table in (table3.FUSIONS, table4.FEATURES):
        assert list(table.rows) == list(table.paper)
        assert all(len(row) == len(ABLATION_COLUMNS) for row in table.paper.values())
        choices = set(table.rows.values())
        assert len(choices) == 4 and getattr(TrackerConfig(), table.field) in choices


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--tracker.fusion", "concat"), "is what the rows differ in"),
        (("--detector", "none.npz"), "none.npz: --detector: expected a checkpoint"),
        (("--seqs", "0000"), "--seqs: expected one, or one for each --data_root"),
    ],
)
def test_what_does_not_fit_is_named(root, tmp_path, more, message):
    with pytest.raises(InputError, match=message):
        table3.main(arguments(root, tmp_path, *more))
