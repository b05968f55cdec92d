"""The quality of segments by hand, and by the definition written out; and the number of them that it picks."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.files.trajectory import Trajectory
from learning.config import TrainConfig, load_config
from learning.samples.samples import segments_of
from learning.segments import quality
from learning.segments.cut import body_graph, ends, segment
from learning.segments.features import Features, features
from physics.schema import InputError, read_table, to_table
from tests.graph_by_hand import one_cell
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


def strip(label):
    """A strip of four triangles over two rows of three nodes, away from the origin, an obstacle beside it; and segments of it."""
    points = np.array([(5.0 + x, 3.0 * y - 7, 2.0) for x in (0, 2, 5) for y in (0, 1)] + [(9.0, 9, 9), (9, 8, 9), (8, 9, 9)])
    cells = np.array([(0, 2, 1), (2, 3, 1), (2, 4, 3), (4, 5, 3), (6, 7, 8)])
    trajectory = Trajectory(points=points, connectivity=cells.ravel(), offsets=3 * np.arange(6), types=np.full(5, 5, np.uint8),
                            node_kind=np.array([0] * 6 + [1] * 3, np.uint8), displacement=np.zeros((1, 9, 3), np.float32),
                            modes=np.zeros((0, 9, 3), np.float32))
    return trajectory, np.array(label)


def test_every_figure_of_three_segments_of_a_strip_on_paper():
    # edges 01 02 12 13 23 24 34 35 45, degrees 2 3 4 4 3 2. Segments {0}, {1, 2, 3}, {4, 5}: volumes 2, 11, 5 of 18; 01, 02 leave the
    # first, these and 24, 34, 35 the second, the latter three the third: 2 / 2, 5 / min(11, 7), 3 / 5, and 5 edges of 9 are cut
    found = quality.segment_quality(*strip([0, 1, 1, 1, 2, 2, 3, 3, 3]))
    assert found["conductance"] == pytest.approx((1 + 5 / 7 + 3 / 5) / 3, rel=1e-15)
    assert found["edge_cut_ratio"] == 5 / 9
    # places (0, 0) (0, 3) (2, 0) (2, 3) (5, 0) (5, 3); node 0 is alone and counts as 0. Distances: 3 within a column, 2 and 13^(1/2)
    # between the first two, 3 and 18^(1/2) between the last two, 5 and 34^(1/2) between the outer two
    a, b, c = 13**0.5, 18**0.5, 34**0.5
    terms = [0.0]
    for near, far in (((a + 2) / 2, min(3, (5 + c) / 2)),  # node 1: to 2 and 3; to 0; to 5 and 4
                      ((a + 3) / 2, min(2, (3 + b) / 2)),  # node 2: to 1 and 3; to 0; to 4 and 5
                      ((2 + 3) / 2, min(a, (3 + b) / 2)),  # node 3: to 1 and 2; to 0; to 5 and 4
                      (3, min(5, (c + 3 + b) / 3)),  # node 4: to 5; to 0; to 1, 2 and 3
                      (3, min(c, (5 + b + 3) / 3))):  # node 5: to 4; to 0; to 1, 2 and 3
        terms.append((far - near) / max(far, near))
    assert found["silhouette"] == pytest.approx(np.mean(terms), rel=1e-12)
    assert list(found) == ["conductance", "edge_cut_ratio", "silhouette"]


def test_a_single_segment_has_nothing_to_cut():
    assert quality.segment_quality(*strip([0] * 6 + [1] * 3)) == {"conductance": 0, "edge_cut_ratio": 0, "silhouette": 0}


def test_nodes_at_one_place_count_as_0():
    # d = 0 to all others: a = b = 0; a node alone has a = 0 and counts as 0 all the same
    assert quality.silhouette(np.array([0, 0, 1, 1]), Features(np.ones((4, 5)), 1.0)) == 0
    assert quality.silhouette(np.array([0, 1]), Features(np.array([[0.0] * 4, [1.0] * 4]), 1.0)) == 0


def test_of_many_nodes_some_are_taken_evenly_in_the_order_of_their_segments(monkeypatch):
    # in the order of segments: nodes 1 3 4 | 0 2 | 5; three of six are the first, the one at 2.5, rounded down, and the last: 1, 4, 5
    monkeypatch.setattr(quality, "SAMPLED", 3)
    table = np.outer([10.0, 0.0, 12.0, 1.0, 4.0, 50.0], [0, 1, 0, 0])  # f_md alone
    # node 1: (1 + 4) / 2 against (10 + 12) / 2; node 4: (4 + 3) / 2 against (6 + 8) / 2; node 5 is alone
    found = quality.silhouette(np.array([1, 0, 1, 0, 0, 2]), Features(np.column_stack([table, 0 * table[:, 0]]), 1.0))
    assert found == pytest.approx(((11 - 2.5) / 11 + (7 - 3.5) / 7 + 0) / 3, rel=1e-12)
    monkeypatch.setattr(quality, "TABLE", 1)  # a row at a time, at least
    assert quality.silhouette(np.array([1, 0, 1, 0, 0, 2]), Features(np.column_stack([table, 0 * table[:, 0]]), 1.0)) == found
    assert quality.silhouette(np.array([0, 0, 1]), Features(np.outer([0.0, 1, 3], [1, 0, 0, 0]), 1.0)) == pytest.approx((2 / 3 + 1 / 2) / 3)


def test_up_to_two_thousand_nodes_all_count():
    for nodes, counted in ((2000, 2000), (2001, 2000)):
        # all at 0 or 1 but for the second node, which alone of its segment is far off: it is left out when there are 2001
        label, place = np.arange(nodes) % 2, np.zeros((nodes, 4))
        label = np.sort(label)
        place[:, 0] = label
        place[1999, 0] = 1e9  # 1999 of 2001 in order: linspace takes 1998 and 2000 there
        chosen = np.arange(nodes) if nodes == counted else np.array([int(i * 2000 / 1999 + 1e-9) for i in range(2000)])
        ones = np.bincount(label)[1]
        terms = []
        for i in chosen.tolist():
            own = ones - 1 if label[i] else nodes - ones - 1
            if i == 1999:
                near, far = 1e9 - 1, 1e9
            elif label[i]:
                near, far = (1e9 - 1) / own, 1.0
            else:
                near, far = 0.0, (ones - 1 + 1e9) / ones
            terms.append((far - near) / max(near, far))
        assert quality.silhouette(label, Features(place, 1.0)) == pytest.approx(np.mean(terms), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("cells, tried", [
    ((1, 1, 1), [1, 2, 3, 4, 5, 6]),  # 8 nodes: eight numbers from 1.41 to 5.66, by factors of 4^(1/7) = 1.22, rounded, each once
    ((8, 3, 2), [5, 6, 8, 9, 11, 14, 17, 21])])  # 108 nodes: from 5.20 to 20.78
def test_auto_tries_eight_numbers_and_keeps_the_first_of_the_best(cells, tried, monkeypatch):
    trajectory, asked = bending(cells=cells), []

    def cut(found, **how):
        asked.append(("cut", how))
        return np.append(np.full(found.body.sum(), how["count"]), [99] * (~found.body).sum())

    def described(found, edges, **how):
        assert np.array_equal(edges, ends(body_graph(trajectory)))
        asked.append(("described", how))
        return how["count"]

    score = {count: -3.0 for count in tried} | {tried[1]: -1.0, tried[3]: -1.0}
    monkeypatch.setattr(quality, "segment", cut)
    monkeypatch.setattr(quality, "features", described)
    monkeypatch.setattr(quality, "silhouette", lambda label, feature: score[feature] if (label == feature).all() else None)
    label, scores = quality.auto_segment(trajectory, method="slic-md", tau=0.25, modes="laplacian", mode_count=3)
    assert label[0] == tried[1] and label[-1] == 99 and scores == score and list(scores) == tried
    how = [dict(count=count, method="slic-md", tau=0.25, modes="laplacian", mode_count=3) for count in tried]
    assert asked == [(name, each) for each in how for name in ("cut", "described")]


def test_auto_tries_no_more_segments_than_nodes():
    _, scores = quality.auto_segment(one_cell(), method="slic-md", modes="laplacian")  # 4 nodes: from 1 to 2 * 2 = 4
    assert list(scores) == [1, 2, 3, 4]


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
    label, feature = cut(bending(cells=(20, 5, 5)))
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
    trajectory = bending(cells=(10, 3, 2))  # 132 nodes
    label, scores = quality.auto_segment(trajectory)
    assert (min(scores), max(scores), len(scores)) == (6, 23, 8)
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
