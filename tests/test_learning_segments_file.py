"""Segments of a file: what is written into it, said about it, drawn of it and given back."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.files.trajectory import problems, read_trajectory, write_trajectory
from learning.segments.cut import segment
from learning.segments.file import segment_file
from learning.segments.quality import auto_segment, segment_quality
from physics import view
from physics.schema import InputError
from tests.graph_by_hand import one_cell
from tests.synthetic import bending

HOW = dict(method="slic-md", tau=0.3, modes="elastic", mode_count=2)


def test_a_file_gets_its_segments_and_nothing_else_changes(tmp_path):
    path, said = tmp_path / "a.vtkhdf", []
    trajectory = replace(bending(cells=(6, 2, 2)), complete=False)  # one whose solver stopped early has a body all the same
    write_trajectory(path, trajectory)
    result = segment_file(path, 4, None, said.append, **HOW)
    label = segment(trajectory, count=4, **HOW)
    kept = read_trajectory(path)
    assert kept.segment.tolist() == label.tolist() and kept.segment[-1] == 4
    assert np.array_equal(kept.displacement, trajectory.displacement) and problems(replace(kept, complete=True)) == []
    nodes = [int((label[:63] == k).sum()) for k in range(4)]  # 7 x 3 x 3 nodes
    quality = segment_quality(trajectory, label)
    assert result.pop("seconds") > 0
    assert result == {"segments": 4, "nodes": nodes, **quality, "silhouette_of": {}}
    assert sum(nodes) == 63 and len(set(nodes)) > 1
    assert said == [f"4 segments of {min(nodes)} to {max(nodes)} nodes, conductance {quality['conductance']:.3f}, edge cut ratio "
                    f"{quality['edge_cut_ratio']:.3f}, silhouette {quality['silhouette']:.3f}: {path}"]


def test_auto_says_what_it_compared(tmp_path):
    path, said = tmp_path / "a.vtkhdf", []
    write_trajectory(path, bending(cells=(6, 2, 2)))
    result = segment_file(path, "auto", None, said.append, **HOW)
    label, scores = auto_segment(bending(cells=(6, 2, 2)), **HOW)
    assert result["silhouette_of"] == scores and len(said) == len(scores) + 1
    assert said[:-1] == [f"{count:5d} segments: silhouette {score:.3f}" for count, score in scores.items()]
    assert said[-1].startswith(f"{max(scores, key=scores.get)} segments of ") and read_trajectory(path).segment.tolist() == label.tolist()


@pytest.mark.parametrize("make", [bending, one_cell])
def test_the_picture_shows_the_body_and_the_obstacle_at_rest(make, tmp_path, monkeypatch):
    path, said, drawn = tmp_path / "a.vtkhdf", [], []
    write_trajectory(path, make())
    monkeypatch.setattr(view, "segment_picture", lambda *arguments, obstacle: drawn.append((*arguments, obstacle)))
    segment_file(path, 2, tmp_path / "s.png", said.append, method="metis")
    (picture, mesh, own, obstacle), = drawn
    body = make().body
    assert picture == tmp_path / "s.png" and said[1] == f"picture: {tmp_path / 's.png'}" and len(said) == 2
    assert np.array_equal(mesh.points, make().points[body])
    assert own.dtype == np.int64 and own.tolist() == read_trajectory(path).segment[body].tolist()
    assert obstacle is None if body.all() else np.array_equal(obstacle.points, make().points[~body])


def test_no_sound_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        segment_file(tmp_path / "none.vtkhdf", 4, None, print)
    wrong = bending(cells=(6, 2, 2))
    wrong.displacement[3, 3, 1] = np.nan
    write_trajectory(tmp_path / "a.vtkhdf", wrong)
    with pytest.raises(InputError, match="displacement is not finite"):
        segment_file(tmp_path / "a.vtkhdf", 4, None, print)
