"""What a family will be like: exact diameters, and the published figures of DeformingBeam."""

import numpy as np
import pytest
import scipy.sparse
from scipy.sparse.csgraph import shortest_path

import fidelity
from datagen.family.family import counts, draw, load_family
from datagen.sets import plan as plan_module
from datagen.sets.plan import figures, graph_diameter, planned, spread, summary
from physics.contact.obstacles import Rigid
from physics.equilibrium.balance import cell_size
from physics.mesh.build import build_mesh
from physics.scene import Body, read_scene
from tests.scenes import pressed


def brute_force(edges, nodes):
    graph = scipy.sparse.csr_matrix((np.ones(len(edges)), edges.T), shape=(nodes, nodes))
    return int(shortest_path(graph, directed=False, unweighted=True).max())


@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("cells", [(1, 1, 1), (7, 2, 3), (3, 6, 5), (20, 4, 4)])
def test_the_diameter_is_that_of_all_pairs(cell, cells):
    mesh = build_mesh(Body(length=1.0, width=1.0, height=1.0, cells=cells, cell=cell))
    assert graph_diameter(mesh.edges, len(mesh.points)) == brute_force(mesh.edges, len(mesh.points))


def test_the_diameter_of_any_graph():
    """Random trees with some more edges: long and short ways, dead ends, cycles."""
    random = np.random.default_rng(0)
    for nodes in (2, 3, 10, 60, 200):
        tree = np.stack([np.arange(1, nodes), [random.integers(max(0, i - 5), i) for i in range(1, nodes)]], axis=1)
        more = random.integers(0, nodes, (nodes // 8, 2))
        edges = np.unique(np.sort(np.concatenate([tree, more[more[:, 0] != more[:, 1]]]), axis=1), axis=0)
        assert graph_diameter(edges, nodes) == brute_force(edges, nodes)


def test_of_a_graph_in_pieces_the_widest_piece_counts():
    """Nodes 0 and 1, and apart from them the path 2, 4, 3, 5."""
    assert graph_diameter(np.array([[0, 1], [2, 4], [3, 4], [3, 5]]), 6) == 3


def test_a_box_has_the_diameter_of_its_closed_form():
    """Bricks form a grid: nx + ny + nz; prisms are a path times the graph of their section, so the diameters add."""
    bricks = build_mesh(Body(length=1.0, width=1.0, height=1.0, cells=(9, 4, 3), cell="hexahedron"))
    assert graph_diameter(bricks.edges, len(bricks.points)) == 16
    section = figures(pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [1, 4, 4]}))["graph_diameter"] - 1
    for nx in (2, 12):
        assert figures(pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [nx, 4, 4]}))["graph_diameter"] == nx + section


@pytest.mark.parametrize(("name", "count", "nodes", "mean", "std"), [
    ("beam", 455, 1542, 41.3, 11.8), ("beam-plane", 455, 771, 41.3, 11.8),
    pytest.param("beam-large", 112, 4540, 82.1, 23.0, marks=pytest.mark.slow),
    pytest.param("beam-plane-large", 112, 2270, 82.1, 23.0, marks=pytest.mark.slow)])
def test_the_families_have_the_published_figures(name, count, nodes, mean, std):
    family = load_family(name)
    plan = planned(family, counts(family))
    assert plan["count"] == count and plan["steps"]["mean"] == plan["steps"]["max"] == 400
    assert plan["nodes"]["mean"] == pytest.approx(nodes, rel=0.02)
    assert plan["graph_diameter"]["mean"] == pytest.approx(mean, rel=0.05)
    assert plan["graph_diameter"]["std"] == pytest.approx(std, rel=0.05)
    shapes = {"cylinder"} if "plane" in name else {"sphere", "cylinder"}
    assert set(plan["obstacle"]) == shapes and set(plan["support"]) == {"x-min", "x-min and x-max"}
    if count == 455:
        assert plan["split"] == {"train": 355, "valid": 40, "test": 60}
    if name == "beam":
        assert plan["xy_extent"]["mean"] == pytest.approx(0.005, rel=0.05)


def test_dry_run_solves_nothing_and_writes_nothing(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert fidelity.main(["generate", "demo", "--dry-run", "--count", "5"]) == 0
    said = capsys.readouterr().out
    assert "graph_diameter" in said and "mean" in said and not list(tmp_path.iterdir())
    assert fidelity.main(["generate", "demo", "--count", "5"]) == 2
    assert "--out" in capsys.readouterr().err


def test_the_figures_of_a_scene_are_those_counted_by_hand():
    """2 x 1 x 1 bricks: 3 x 2 x 2 nodes, the farthest two 2 + 1 + 1 edges apart."""
    table = {"body": {"length": 0.5, "width": 0.3, "height": 0.2, "cells": [2, 1, 1], "cell": "hexahedron"},
             "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "steps": {"count": 7}}
    assert figures(read_scene(table)) == {"nodes": 12, "cells": 2, "graph_diameter": 4, "steps": 7, "xy_extent": pytest.approx(0.15),
                                          "obstacle": "none", "support": "none"}
    scene = read_scene(table | {"support": [{"where": "x-min"}, {"where": "x-max"}],
                                "obstacle": {"shape": "sphere", "radius": 0.1, "path": [[0, 0, 0.9], [0, 0, 0.8]]}})
    mesh = build_mesh(scene.body)
    around = Rigid(scene.obstacle).surface_mesh(mesh.points, size=cell_size(mesh))[0]
    found = figures(scene)
    assert found["nodes"] == 12 + len(around) > 12 and (found["obstacle"], found["support"]) == ("sphere", "x-min and x-max")


def test_a_spread_is_of_the_sample_itself():
    """2, 4 and 9: mean 5, squares of the deviations 9 + 1 + 16, over 3."""
    assert spread([4, 2, 9]) == pytest.approx({"mean": 5, "std": (26 / 3) ** 0.5, "min": 2, "max": 9}, rel=1e-15)
    assert summary([{"n": 4, "word": "b"}, {"n": 2, "word": "a"}, {"n": 9, "word": "b"}]) == {
        "count": 3, "n": spread([4, 2, 9]), "word": {"a": 1, "b": 2}}


def test_a_plan_is_of_the_scenes_that_would_be_made():
    """The lengths of each split's own draws, by its seed; 0.024 m wide and high bodies give the same figures otherwise."""
    family = load_family("demo")
    for seed in (0, 3):
        plan = planned(family, {"train": 2, "test": 1}, seed=seed)
        scenes = [draw(family, seed, index) for index in (0, 1, 2_000_000)]
        area = [scene.body.length * scene.body.width for scene in scenes]
        assert plan["xy_extent"] == pytest.approx({"mean": np.mean(area), "std": np.std(area), "min": min(area), "max": max(area)})
        assert plan["split"] == {"train": 2, "test": 1} and plan["count"] == 3


def test_a_diameter_is_found_by_few_searches(monkeypatch):
    """A path of 301 nodes takes three: from any node, from an end, and one more to close the bounds; a grid a few more."""
    searches = []
    monkeypatch.setattr(plan_module, "dijkstra", lambda *args, **given: searches.append(1) or honest(*args, **given))
    honest = scipy.sparse.csgraph.dijkstra
    path = np.stack([np.arange(300), np.arange(1, 301)], axis=1)
    assert graph_diameter(path, 301) == 300 and len(searches) <= 4
    searches.clear()
    mesh = build_mesh(Body(length=1.0, width=1.0, height=1.0, cells=(20, 4, 4), cell="prism"))
    assert graph_diameter(mesh.edges, len(mesh.points)) == brute_force(mesh.edges, len(mesh.points))
    assert len(searches) < len(mesh.points) / 8


def test_of_scenes_that_ask_for_an_error_no_mesh_is_foreseen():
    scene = pressed(body={"length": 0.06, "width": 0.02, "height": 0.02}, steps={"count": 20, "error": 0.03})
    assert figures(scene) == {"steps": 20, "error": 0.03, "obstacle": "cylinder", "support": "x-min"}
