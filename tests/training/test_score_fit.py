"""The regression behind box scores, and its cross-validation by drive."""

import numpy as np
import pytest
from scipy.special import expit

from common.errors import InputError
from models.boxes.box_decoding import Clusters
from training.scoring.box_candidates import Candidates
from training.scoring.logistic import fit_logistic, log_loss
from training.scoring.score_fit import (
    Domain,
    Penalty,
    ScoreFit,
    choose_penalty,
    counted_boxes,
    samples,
)
from training.scoring.score_report import draw, report, table

NAMES = ("signal", "noise", "FC1 0 mean")


def test_the_regression_finds_the_probabilities():
    rng = np.random.default_rng(0)
    x = rng.normal(5, 2, (4000, 2)) * (1, 100)
    logit = 1.5 * (x[:, 0] - 5) / 2 - 0.5
    y = rng.random(4000) < expit(logit)
    model = fit_logistic(x, y, np.ones(4000), np.full(2, 1e-6))
    assert np.abs(model.probability(x) - expit(logit)).mean() < 0.02
    assert log_loss(model.probability(x), y) < log_loss(np.full(4000, y.mean()), y)


def test_the_optimum_has_no_gradient():
    """At the minimum, the penalty balances the residuals of every standardised feature."""
    rng = np.random.default_rng(1)
    x, y, weight = rng.normal(0, 1, (50, 3)), rng.random(50) < 0.4, rng.uniform(0.5, 2, 50)
    penalty = np.array([0.1, 0.01, 1.0])
    model = fit_logistic(x, y, weight, penalty)
    share, z = weight / weight.sum(), (x - model.mean) / model.scale
    np.testing.assert_allclose(share @ z, 0, atol=1e-12)
    residual = share * (model.probability(x) - y)
    np.testing.assert_allclose(residual @ z + penalty * model.weight, 0, atol=1e-4)
    assert residual.sum() == pytest.approx(0, abs=1e-4)


def test_a_constant_feature_does_no_harm():
    x = np.column_stack([np.ones(20), np.arange(20.0)])
    model = fit_logistic(x, np.arange(20) > 9, np.ones(20), np.full(2, 0.01))
    assert np.isfinite(model.probability(x)).all() and model.weight[0] == pytest.approx(0, abs=1e-6)


def frame(drive: str, seed: int, count: int = 20) -> Candidates:
    """A frame whose first feature separates right and wrong boxes; one box is in DontCare."""
    rng = np.random.default_rng(seed)
    right = rng.random(count) < 0.5
    values = {name: rng.normal(0, 1, count) for name in NAMES}
    values["signal"] += 3 * right
    iou = np.zeros((right.sum(), count))
    iou[np.arange(right.sum()), np.flatnonzero(right)] = 0.8
    ignorable = np.zeros(count, bool)
    ignorable[np.flatnonzero(~right)[0]] = True
    agreement = rng.random(count).astype("f4")
    clusters = Clusters(np.zeros((count, 7), "f4"), agreement, None, None, None, None, None)
    points, truth = np.full(len(iou), 30), np.zeros((len(iou), 7))
    return Candidates(drive, 0, clusters, values, iou, points, ignorable, truth, points * 1.0)


def domains() -> list[Domain]:
    """Two domains of three drives, two frames each."""
    drives = [[f"{kind}/{d}" for d in range(3)] for kind in ("real", "simulated")]
    seeds = iter(range(100))
    return [Domain([frame(d, next(seeds)) for d in each for _ in range(2)]) for each in drives]


def test_boxes_in_dontcare_regions_are_left_out_unless_right():
    one = frame("a", 0)
    assert len(samples([one], NAMES).right) == 19
    assert samples([one], NAMES).right.sum() == len(one.iou)
    scores, right = counted_boxes([one], [np.linspace(0, 1, 20)])
    assert len(scores) == 19 and right.sum() == len(one.iou)


def test_a_drive_is_scored_by_a_regression_that_did_not_see_it():
    """Labels of one drive turned round change the scores of all drives but its own."""
    both = domains()
    changed = [Domain(list(d.frames)) for d in both]
    for i in (0, 1):
        old = changed[0].frames[i]
        values = {**old.features, "signal": -old.features["signal"]}
        changed[0].frames[i] = Candidates(**{**vars(old), "features": values})
    before = ScoreFit(both, Penalty(0.01, 0.1)).cross_validated(3)
    after = ScoreFit(changed, Penalty(0.01, 0.1)).cross_validated(3)
    turned = ScoreFit(both, Penalty(0.01, 0.1))
    same = turned.scores(turned.fit(["real/0", "simulated/0"]), changed[0].frames[0])
    np.testing.assert_allclose(after[0][0], same)
    assert not np.allclose(before[1][2], after[1][2])


def test_features_of_fc1_can_be_left_out():
    fit = ScoreFit(domains(), Penalty(0.01, None))
    assert fit.names == ["signal", "noise"]
    scorer = fit.scorer("hash", 0.4)
    one = domains()[0].frames[0]
    np.testing.assert_allclose(scorer.scores(one.features), fit.scores(fit.fit(), one))
    assert scorer.weight[0] > 1 > abs(scorer.weight[1])


def test_the_penalty_of_least_loss_is_chosen():
    grid = (Penalty(0.01, None), Penalty(100.0, None))
    best, losses = choose_penalty(domains(), 3, grid)
    assert best == grid[0] and len(losses) == 2


def test_a_single_drive_cannot_be_validated():
    alone = [Domain([frame("a", 0), frame("a", 1)])]
    with pytest.raises(InputError, match="two or more drives"):
        ScoreFit(alone, Penalty(0.01, None)).cross_validated(3)


def test_frames_without_a_counted_box_are_reported(tmp_path):
    one = frame("a", 0)
    nothing = np.zeros((len(one.iou), 20))
    hidden = Candidates(**{**vars(one), "iou": nothing, "ignorable": np.ones(20, bool)})
    parts = {"real": report([hidden], [np.linspace(0, 1, 20)], 0.5)}
    draw(parts, tmp_path / "reliability.png")
    assert (parts["real"]["boxes"], parts["real"]["expected_calibration_error"]) == (0, None)
    assert table(parts).splitlines()[-1].split("|")[-2].strip() == "-"


def test_no_boxes_at_all():
    none = frame("a", 0)
    none = Candidates(**{**vars(none), "features": {}})
    with pytest.raises(InputError, match="proposes boxes"):
        ScoreFit([Domain([none])], Penalty(0.01, None))
