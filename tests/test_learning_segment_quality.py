"""The quality of segments by hand, and by the definition written out; and the number of them that it picks."""

from dataclasses import replace

import numpy as np
import pytest

from learning import segment_quality as quality
from learning.config import TrainConfig, load_config
from learning.data import segments_of
from learning.features import Features, features
from learning.segments import body_graph, ends, segment
from physics.schema import InputError, read_table, to_table
from tests.synthetic import bending


def distances(feature):
    """(N, N) d(i, j) of all nodes, from its definition."""
    difference = np.abs(feature.table[:, None] - feature.table)
    return (difference[:, :, 0] + np.linalg.norm(difference[:, :, 1:-3], axis=2)
            + feature.tau * np.linalg.norm(difference[:, :, -3:], axis=2))


def cut(trajectory, count=7, method="slic-mdod-e"):
    """Segments of the body, and the features they were cut by."""
    how = dict(count=count, method=method, tau=0.5)
    return segment(trajectory, **how)[trajectory.body], features(trajectory, ends(body_graph(trajectory)), **how)


def test_quality_of_two_halves_by_hand():
    # a row of 4 prism layers cut in the middle: 9 edges along x and none across leave the cut, of 4*9 + 5*16 = 116
    trajectory = bending(cells=(4, 2, 2))
    label = np.where(trajectory.points[:, 0] > 0.0625 - 1e-9, 1, 0)
    found = quality.segment_quality(trajectory, label)
    assert found["edge_cut_ratio"] == 9 / 116
    larger, smaller = 3 * 32 + 2 * 18 + 9, 2 * 32 + 1 * 18 + 9  # sums of degrees on either side
    assert larger + smaller == 2 * 116
    assert found["conductance"] == 9 / smaller


@pytest.mark.parametrize("method", ["metis", "slic-mdod-e"])
def test_silhouette_is_its_definition(method):
    label, feature = cut(bending(cells=(10, 2, 2)), method=method)
    label[3] = 7  # a node alone in its segment counts as 0
    d, terms = distances(feature), []
    for i in range(len(label)):
        mean = [d[i, (label == k) & (np.arange(len(label)) != i)] for k in range(8)]
        if len(mean[label[i]]) == 0:
            terms.append(0.0)
            continue
        a, b = mean[label[i]].mean(), min(mean[k].mean() for k in range(8) if k != label[i])
        terms.append((b - a) / max(a, b))
    assert quality.silhouette(label, feature) == pytest.approx(np.mean(terms), rel=1e-12)


def test_a_silhouette_in_parts_is_the_same_and_one_of_a_sample_near(monkeypatch):
    label, feature = cut(bending(cells=(40, 5, 5)))
    whole = quality.silhouette(label, feature)
    monkeypatch.setattr(quality, "TABLE", 10_000)
    assert quality.silhouette(label, feature) == pytest.approx(whole, rel=1e-12)
    monkeypatch.setattr(quality, "SAMPLED", 400)
    assert quality.silhouette(label, feature) == pytest.approx(whole, abs=0.05)  # values spread by 0.3: 3 standard errors of 400


def test_separate_blobs_score_one_and_mixed_ones_zero():
    rng = np.random.default_rng(0)
    label = np.arange(200) % 2
    place = rng.normal(size=(200, 4)) * [0, 1, 1, 1]
    assert quality.silhouette(label, Features(place + 1e4 * label[:, None] * [0, 1, 0, 0], 1.0)) > 0.999
    assert abs(quality.silhouette(label, Features(place, 1.0))) < 0.05
    assert quality.silhouette(np.zeros(200, int), Features(place, 1.0)) == 0


def test_auto_takes_the_best_silhouette_between_half_and_twice_the_root_of_the_nodes():
    trajectory = bending(cells=(20, 4, 4))  # 525 nodes
    label, scores = quality.auto_segment(trajectory)
    assert (min(scores), max(scores), len(scores)) == (11, 46, 8)
    for count, score in scores.items():
        own, feature = cut(trajectory, count=count)
        assert quality.silhouette(own, feature) == score
    best = max(scores, key=lambda count: scores[count])
    assert np.array_equal(label, segment(trajectory, count=best))


def test_auto_is_a_number_of_segments_in_a_config(tmp_path):
    config = read_table(TrainConfig, {"segments": "auto", "method": "slic-md"})
    assert to_table(config)["segments"] == "auto" and read_table(TrainConfig, to_table(config)) == config
    trajectory = bending()
    assert np.array_equal(segments_of(trajectory, config), quality.auto_segment(trajectory, method="slic-md")[0])
    assert np.array_equal(segments_of(trajectory, replace(config, segments=5)), segment(trajectory, count=5, method="slic-md"))
    for text, words in (("segments = 'many'", "must be one of auto"), ("segments = 1.5", "must be an integer"),
                        ("segments = 0", "at least 1"), ("segments = true", "must be an integer"), ("modes = 'both'", "must be one of")):
        (tmp_path / "c.toml").write_text(text)
        with pytest.raises(InputError, match=words):
            load_config(tmp_path / "c.toml")
