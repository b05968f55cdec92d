"""What a page is given of a body in motion, read back as its program reads it: places, colours, surface, and how far they are off."""

import base64

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body, Material
from physics.view.drawing import ObstacleSurface, feature_edges
from physics.view.exhibit import FRAMES, Animation, Exhibit, at_nodes, mode_exhibit, path_exhibit, stored

MESH = build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=(5, 2, 3)))
BOX = build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=(5, 2, 3), cell="hexahedron"))
RUBBER = Material(law="linear", young_modulus=1e6, poisson_ratio=0.0)
ROOM = 10**7


def bent(frames: int = 6, mesh: Mesh = MESH) -> np.ndarray:
    """(T, N, 3) a cantilever that goes down by 20 mm."""
    moved = np.zeros((frames, *mesh.points.shape))
    moved[..., 2] = -0.02 * np.linspace(0, 1, frames)[:, None] * (mesh.points[:, 0] / 0.1) ** 2
    return moved


def names(frames) -> list[str]:
    return [f"step {k}" for k in range(len(frames))]


def array(text: str, kind: str, width: int = 1) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, width)


def frames_of(motion: dict, count: int, key: str | None = None) -> np.ndarray:
    """(T, n) of a motion or one of its fields, from base64."""
    packed = motion["motion"] if key is None else motion["fields"][key]
    shapes = array(packed["shapes"], "<i2").reshape(packed["rank"], -1).astype(float)
    return array(packed["coefficients"], "<f4").reshape(count, packed["rank"]).astype(float) @ shapes


def shown(path, *others, mesh: Mesh = MESH, room: int = ROOM, **more) -> dict:
    motions = {"truth": Animation(displacement=path)} | {f"guess {i}": Animation(displacement=other) for i, other in enumerate(others)}
    return stored(Exhibit(title="t", mesh=mesh, motions=motions, frames=names(path), **({"truth": "truth"} | more)), room)


def test_places_are_kept_to_a_ten_thousandth_and_the_page_says_how_well():
    content = shown(bent())
    surface = array(content["nodes"], "<u4")[:, 0]
    seen = frames_of(content["motions"][0], 6).reshape(6, -1, 3)
    off = np.linalg.norm(seen - bent()[:, surface], axis=2).max()
    assert content["motions"][0]["within"]["displacement"] == pytest.approx(off, rel=1e-9) and 0 < off < 1e-4 * 0.02
    assert np.array_equal(array(content["points"], "<f4", 3), MESH.points[surface].astype(np.float32))
    assert content["motions"][0]["drawn"] == f"truth: displacement {1e3 * off:.2g} mm"


@pytest.mark.parametrize("size", [1e-3, 1e-9])
def test_an_error_is_kept_as_well_when_it_is_a_millionth_of_the_motion(size):
    """A prediction is stored as its difference to the truth: a level of colour has 1 / 256 of the largest error."""
    rng = np.random.default_rng(0)
    wrong = bent() + size * rng.uniform(-1, 1, bent().shape)
    content = shown(bent(), wrong)
    truth, guess = content["motions"]
    surface = array(content["nodes"], "<u4")[:, 0]
    assert guess["above"] and not truth["above"]
    error = np.linalg.norm(frames_of(guess, 6).reshape(6, -1, 3), axis=2)
    right = np.linalg.norm((wrong - bent())[:, surface], axis=2)
    assert abs(error - right).max() < right.max() / 256
    assert guess["within"]["error"] < right.max() / 512 and guess["within"]["error"] >= abs(error - right).max() - 1e-15
    assert guess["drawn"].startswith(f"guess 0: error {1e3 * guess['within']['error']:.2g} mm, displacement ")
    places = frames_of(truth, 6) + frames_of(guess, 6)
    assert guess["within"]["displacement"] == pytest.approx(
        np.linalg.norm(places.reshape(6, -1, 3) - wrong[:, surface], axis=2).max(), rel=1e-6)


def test_figures_are_of_all_nodes_those_inside_included():
    inside = np.setdiff1d(np.arange(len(MESH.points)), np.unique(np.concatenate([part.ravel() for part in MESH.surface])))
    wrong = bent()
    wrong[4, inside[0]] += [0, 3e-2, 4e-2]
    content = shown(bent(), wrong)
    assert content["motions"][1]["curves"]["error"] == pytest.approx([0, 0, 0, 0, 5e-2, 0])
    assert content["motions"][1]["curves"]["displacement"][4] == pytest.approx(np.linalg.norm(wrong[4, inside[0]]), rel=1e-4)
    assert content["motions"][0]["curves"]["error"] == [0] * 6
    assert content["motions"][0]["curves"]["displacement"] == pytest.approx(np.linspace(0, 0.02, 6), rel=1e-4)
    assert not set(array(content["nodes"], "<u4")[:, 0]) & set(inside) and len(inside) == 4 * 1 * 2


@pytest.mark.parametrize("mesh", [MESH, BOX])
def test_the_triangles_are_the_surface_turned_outwards(mesh):
    content = shown(bent(mesh=mesh), mesh=mesh)
    points, triangles = array(content["points"], "<f4", 3).astype(float), array(content["triangles"], "<u4", 3)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a) / 2
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(2 * (0.1 * 0.02 + 0.1 * 0.03 + 0.02 * 0.03), rel=1e-6)
    assert (normals * a).sum() / 3 == pytest.approx(0.1 * 0.02 * 0.03, rel=1e-6)  # the volume, by Gauss


def test_edges_are_those_of_the_facets_each_once_and_the_outline_is_the_box():
    content = shown(bent(mesh=BOX), mesh=BOX)
    edges = array(content["edges"], "<u4", 2)
    # 62 faces of boxes: 2 (5*2 + 5*3 + 2*3), each edge between two of them
    assert len(edges) == 62 * 4 / 2 == len(np.unique(edges, axis=0)) and (edges[:, 0] < edges[:, 1]).all()
    points = array(content["points"], "<f4", 3).astype(float)
    assert ((abs(np.diff(points[edges], axis=1)[:, 0]) > 1e-6).sum(axis=1) == 1).all()  # along the box's sides, none a diagonal
    rim = points[array(content["outline"], "<u4", 2)]
    assert np.linalg.norm(rim[:, 0] - rim[:, 1], axis=1).sum() == pytest.approx(4 * (0.1 + 0.02 + 0.03), rel=1e-6)
    assert feature_edges(BOX).max() > len(points) - 10  # those are numbers of all nodes


def test_what_blows_up_is_left_out_and_named():
    paths = {"fine": bent(), "nan": bent(), "far": bent(), "almost": bent()}
    paths["nan"][3, 0, 0], paths["far"][3, 0, 0], paths["almost"][3, 0, 0] = np.nan, 110.0, 90.0  # a thousand lengths of 0.1 m
    exhibit = path_exhibit("t", MESH, paths, RUBBER, truth="fine")
    assert exhibit.blown_up == ["nan", "far"] and list(exhibit.drawable.motions) == ["fine", "almost"]
    assert exhibit.motions["nan"].fields == {} and stored(exhibit.drawable, ROOM)["motions"][1]["name"] == "almost"


def test_where_there_is_no_room_there_are_fewer_shapes_and_a_larger_error_is_told():
    noise = np.random.default_rng(1).normal(size=(40, *MESH.points.shape))
    whole, little = shown(noise)["motions"][0], shown(noise, room=10_000)["motions"][0]
    assert whole["motion"]["rank"] == 40 and whole["within"]["displacement"] < 1e-3
    size = len(little["motion"]["shapes"]) + len(little["motion"]["coefficients"])
    assert 8_000 < size < 10_000 and little["within"]["displacement"] > 1


def test_a_stress_at_a_node_is_the_mean_of_its_cells_that_have_one():
    pair = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]]),
                np.array([[0, 1, 4, 3], [1, 2, 5, 4]]), "quadrilateral", {})
    assert at_nodes(pair, np.array([[2.0, 4.0], [2.0, np.nan], [np.nan, np.inf]])).tolist() == [
        [2, 3, 4, 2, 3, 4], [2, 2, 0, 2, 2, 0], [0, 0, 0, 0, 0, 0]]


def test_the_stress_of_a_stretched_bar_is_its_modulus_times_its_strain():
    """1 % in 10 steps of a material with E = 1 MPa and nu = 0: 10 kPa everywhere."""
    pull = np.linspace(0, 0.01, 11)[:, None, None] * MESH.points * [1.0, 0, 0]
    exhibit = path_exhibit("bar", MESH, {"fe": pull}, RUBBER)
    assert exhibit.motions["fe"].fields["von Mises stress [kPa]"] == pytest.approx(
        np.tile(np.arange(11.0)[:, None], (1, len(MESH.points))), abs=1e-9)
    assert exhibit.frames[3] == "step 3 of 10"
    content = stored(exhibit, ROOM)
    assert frames_of(content["motions"][0], 11, "von Mises stress [kPa]")[10] == pytest.approx(10, rel=1 / 512)
    assert [(each["name"], each["unit"], each["factor"], each["signed"]) for each in content["quantities"]] == [
        ("displacement", "mm", 1e3, False), ("von Mises stress", "kPa", 1.0, False)]


@pytest.mark.parametrize("modulus, unit", [(1e3, "Pa"), (1e6, "kPa"), (1e9, "MPa"), (1e12, "GPa")])
def test_stress_is_told_in_the_unit_without_many_zeros(modulus, unit):
    pull = np.linspace(0, 0.01, 2)[:, None, None] * MESH.points * [1.0, 0, 0]
    exhibit = path_exhibit("bar", MESH, {"fe": pull}, Material(law="linear", young_modulus=modulus, poisson_ratio=0.0))
    assert exhibit.motions["fe"].fields[f"von Mises stress [{unit}]"].max() == pytest.approx(10)


def test_a_long_path_is_thinned_and_its_frames_keep_their_numbers():
    path = bent(1201)
    ball = ObstacleSurface(np.linspace(0, 1, 1201)[:, None, None] * np.ones((1, 4, 3)), np.array([[0, 1, 2]]))
    exhibit = path_exhibit("long", MESH, {"fe": path}, RUBBER, obstacle=ball, step_seconds=0.01)
    assert len(exhibit.frames) == FRAMES == 401
    assert exhibit.frames[0] == "step 0 of 1200, 0 s" and exhibit.frames[200] == "step 600 of 1200, 6 s"
    assert np.array_equal(exhibit.motions["fe"].displacement[-1], path[-1]) and exhibit.obstacle.points[200, 0, 0] == 0.5


def test_one_frame_keeps_its_number():
    assert path_exhibit("one", MESH, {"fe": bent()[3:4]}, RUBBER, first=3, steps=5).frames == ["step 3 of 5"]


def test_errors_are_asked_for_only_beside_a_truth():
    assert [each["key"] for each in shown(bent(), bent())["quantities"]] == ["error", "displacement"]
    assert [each["key"] for each in shown(bent())["quantities"]] == ["displacement"]
    lone = shown(bent(), bent(), truth="")
    assert [each["key"] for each in lone["quantities"]] == ["displacement"]
    assert not any(motion["above"] for motion in lone["motions"]) and "error" not in lone["motions"][0]["curves"]


def test_a_mode_swings_once_and_its_largest_displacement_is_one():
    mode = np.zeros((1, *MESH.points.shape))
    mode[0, :, 2] = 7.0 * (MESH.points[:, 0] / 0.1) ** 2
    content = stored(mode_exhibit(MESH, mode, ["first"], frames=8), ROOM)
    curve = content["quantities"][0]["factor"] * np.array(content["motions"][0]["curves"]["displacement"])
    assert curve == pytest.approx(abs(np.cos(2 * np.pi * np.arange(8) / 8)), abs=1e-4)
    assert content["motions"][0]["motion"]["rank"] == 1 and content["frames"][1] == "phase 45 degrees"
    assert frames_of(content["motions"][0], 8).max() == pytest.approx(0.1 / 6, rel=1e-3)


def test_a_scalar_mode_colours_a_body_that_stays():
    content = stored(mode_exhibit(MESH, -3.0 * MESH.points[None, :, 0], ["first"], frames=4), ROOM)
    best = content["quantities"][0]
    assert (best["name"], best["unit"], best["signed"]) == ("value", "of the largest", True)
    assert content["motions"][0]["motion"]["rank"] == 0
    values = frames_of(content["motions"][0], 4, best["key"])
    assert values[0].min() == pytest.approx(-1, rel=1 / 512) and values[2].max() == pytest.approx(1, rel=1 / 512)


def test_an_obstacle_is_where_it_was():
    ball = ObstacleSurface(np.arange(6)[:, None, None] * [0, 0, -1e-3] + np.array([[0.0, 0, 0.05], [0.01, 0, 0.05], [0, 0.01, 0.05]]),
                    np.array([[0, 1, 2]]))
    motions = {"fe": Animation(displacement=bent())}
    content = stored(Exhibit(title="t", mesh=MESH, motions=motions, frames=names(bent()), obstacle=ball), ROOM)
    packed = content["obstacle"]
    moved = frames_of({"motion": packed["motion"]}, 6).reshape(6, 3, 3) + array(packed["points"], "<f4", 3)
    assert moved == pytest.approx(ball.points, abs=1e-6) and packed["motion"]["rank"] == 1
