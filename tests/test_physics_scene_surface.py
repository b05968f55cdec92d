"""Surfaces of obstacles from files: what is read, what is mended, and what is refused in one line."""

import base64

import meshio
import numpy as np
import pytest

from physics.scene import Scene, load_scene, read_scene
from physics.scene import surface as module
from physics.scene.surface import read_surface, sound, surface_in, winding
from physics.schema import InputError
from tests.tools import SPANNER, ball, brick, spanner, text_of, written

CUBE = brick((1.0, 1.0, 1.0), 0.0, 9.0)
SCENE = {"body": {"shape": "beam", "length": 0.1, "width": 0.02, "height": 0.02, "cells": [4, 1, 1]},
         "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}]}


def volume(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float((np.cross(a, b) * c).sum()) / 6


def scene(**obstacle):
    return read_scene(SCENE | {"obstacle": {"shape": "mesh", "path": [[0, 0, 0.1]]} | obstacle})


@pytest.mark.parametrize("name", ["a.stl", "a.obj", "a.ply", "a.vtk", "a.off"])
def test_files_of_any_kind_give_the_surface(tmp_path, name):
    points, triangles = surface_in(read_surface(written(tmp_path / name, spanner()))[0])
    x, y = SPANNER.T
    area = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    assert len(points) == 24 and len(triangles) == 44 and volume(points, triangles) == pytest.approx(6 * area, rel=1e-6)


def test_quadrilaterals_are_cut_and_binary_files_are_read(tmp_path):
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    faces = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    meshio.Mesh(corners, [("quad", faces)]).write(tmp_path / "a.ply", binary=True)
    points, triangles = surface_in(read_surface(tmp_path / "a.ply")[0])
    assert len(triangles) == 12 and volume(points, triangles) == pytest.approx(1)


def test_triangles_and_pieces_that_look_inwards_are_turned_and_said_so():
    points, triangles = CUBE
    turned = triangles.copy()
    turned[[3, 7]] = turned[[3, 7], ::-1]
    found, kept, said = sound(points, turned)
    assert volume(found, kept) == pytest.approx(8) and said == ["2 of 12 triangles looked inwards and have been turned"]
    found, kept, said = sound(points, triangles[:, ::-1])
    assert volume(found, kept) == pytest.approx(8) and said == ["12 of 12 triangles looked inwards and have been turned"]
    both = np.concatenate([triangles, triangles[:, ::-1] + 8])
    found, kept, said = sound(np.concatenate([points, points + [5, 0, 0]]), both)
    assert volume(found, kept) == pytest.approx(16) and said == ["12 of 24 triangles looked inwards and have been turned"]
    assert sound(points, triangles)[2] == []


def test_points_are_made_one_and_triangles_without_three_corners_left_out():
    points, triangles = CUBE
    apart, loose = points[triangles].reshape(-1, 3), np.arange(36).reshape(-1, 3)
    lone = np.concatenate([loose, [[0, 0, 1]]])
    found, kept, said = sound(np.concatenate([apart, [[9, 9, 9]]]), lone)
    assert len(found) == 8 and len(kept) == 12 and said == ["1 triangles with two corners in one left out"]


WRONG = {
    "open": (lambda p, t: (p, t[1:]), "is not closed: the edge from .* belongs to 1 triangle, not to two"),
    "twice": (lambda p, t: (p, np.concatenate([t, t[:1]])), "a triangle is there twice, at"),
    "three at an edge": (lambda p, t: (np.concatenate([p, [[0, 0, 5]]]), np.concatenate([t, [[t[0, 0], t[0, 1], 8]]])), "is not closed"),
    "flat": (lambda p, t: (np.concatenate([p, p[t[0, :2]].mean(axis=0, keepdims=True)]), np.concatenate([t, [[t[0, 0], t[0, 1], 8]]])),
             "has no area"),
    "within": (lambda p, t: (np.concatenate([p, p / 2]), np.concatenate([t, t + 8])), "runs into itself, or has a piece within another"),
    "crossing": (lambda p, t: (np.concatenate([p, p + 0.5]), np.concatenate([t, t + 8])), "runs into itself"),
    "not finite": (lambda p, t: (np.where(p > 0, np.nan, p), t), "not finite"),
    "no triangles": (lambda p, t: (p, t[:0]), "no triangles"),
    "no such point": (lambda p, t: (p, t + 1), "names a point that is not there"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_no_closed_surface_is_refused_in_one_line(case):
    change, words = WRONG[case]
    with pytest.raises(InputError, match=words):
        sound(*change(*CUBE))


def test_a_surface_with_one_side_is_refused():
    """A Klein bottle, of squares of a torus whose last column is joined to the first one turned over."""
    n = 6
    square = [(i, j, i + 1, j, i + 1, j + 1, i, j + 1) for i in range(n) for j in range(n)]
    number = lambda i, j: (i % n) * n + ((-j if i >= n else j) % n)  # noqa: E731
    corners = np.array([[number(s[k], s[k + 1]) for k in range(0, 8, 2)] for s in square])
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    with pytest.raises(InputError, match="has one side only"):
        sound(np.random.default_rng(0).normal(size=(n * n, 3)), triangles)


def test_winding_numbers_count_how_often_a_surface_goes_round():
    points, triangles = ball(1.0, 0.6)
    twice = np.concatenate([points, points / 2]), np.concatenate([triangles, triangles + len(points)])
    assert winding(np.array([[2.0, 0, 0], [0.7, 0, 0], [0.1, 0.2, 0]]), *twice) == pytest.approx([0, 1, 2], abs=1e-12)


def test_a_scene_holds_the_surface_and_needs_the_file_no_more(tmp_path):
    written(tmp_path / "tool.stl", spanner())
    text = 'shape = "mesh"\nfile = "tool.stl"\nscale = 0.001\naxis = [0, 0, 1]\nangle = 30\npath = [[0, 0, 0.1]]\n'
    head = "[body]\nlength = 0.1\nwidth = 0.02\nheight = 0.02\ncells = [4, 1, 1]\n[material]\nyoung_modulus = 1e6\npoisson_ratio = 0.4\n"
    (tmp_path / "s.toml").write_text(head + '[[support]]\nwhere = "x-min"\n[obstacle]\n' + text)
    loaded = load_scene(tmp_path / "s.toml")
    (tmp_path / "tool.stl").unlink()
    assert loaded.obstacle.file is None and loaded.obstacle.source == "tool.stl" and "file" not in loaded.to_toml()
    assert Scene.from_toml(loaded.to_toml()) == loaded
    with pytest.raises(InputError, match=r"obstacle.file: .*tool.stl: no such file"):
        load_scene(tmp_path / "s.toml")


def test_what_a_mesh_takes_and_refuses(tmp_path):
    text = text_of(*sound(*CUBE)[:2])
    for keys, words in (({}, "obstacle: a mesh has a file, which is missing"),
                        ({"surface": text, "file": "a.stl"}, "a surface stands in its place"),
                        ({"surface": text, "length": 1.0}, "obstacle.length: a mesh has none"),
                        ({"surface": text, "radius": 0.6}, "must be from 0.01 to 0.5 m"),
                        ({"surface": text, "radius": 0.001}, "must be from 0.01 to 0.5 m"),
                        ({"surface": text, "scale": 1e-10}, "obstacle: 2e-10 m wide"),
                        ({"surface": text[:-4]}, "obstacle.surface: not a surface"), ({"surface": "!"}, "obstacle.surface: not a surface"),
                        ({"surface": text[:8] + "\n" + text[8:]}, "obstacle.surface: not a surface"),
                        ({"surface": ""}, "obstacle.surface: not a surface"),
                        ({"surface": text, "angle": 5.0, "axis": [0, 0, 0]}, "obstacle.axis must not be the zero vector"),
                        ({"surface": text_of(CUBE[0], CUBE[1][:, ::-1])}, "its triangles want mending"),
                        ({"shape": "sphere", "radius": 1.0, "angle": 3.0}, "obstacle.angle: a sphere has none"),
                        ({"shape": "sphere", "radius": 1.0, "file": "a.stl"}, "obstacle.file: a sphere has none")):
        with pytest.raises(InputError, match=words):
            scene(**keys)
    (tmp_path / "a.stl").write_text("nothing of the kind")
    with pytest.raises(InputError, match=r"obstacle.file: .*a.stl: not a mesh file"):
        scene(file=str(tmp_path / "a.stl"))
    meshio.Mesh(np.eye(4, 3), [("tetra", np.array([[0, 1, 2, 3]]))]).write(tmp_path / "a.vtk")
    with pytest.raises(InputError, match="has cells of the kind tetra; an obstacle's surface is made of triangles"):
        scene(file=str(tmp_path / "a.vtk"))


def test_beside_a_plane_body_a_box_turns_in_its_plane_and_a_mesh_is_refused():
    from physics.scene.plane import check_plane

    plane = SCENE | {"body": {"shape": "plate", "length": 1.0, "width": 1.0, "cells": [2, 2], "cell": "quadrilateral"}}
    box = {"shape": "box", "size": [1, 1, 1], "path": [[0, 5, 0]], "angle": 20.0}
    check_plane(read_scene(plane | {"obstacle": box | {"axis": [0, 0, 1]}}))
    with pytest.raises(InputError, match="beside a plane body a box turns about"):
        check_plane(read_scene(plane | {"obstacle": box}))
    with pytest.raises(InputError, match="meets solid bodies only"):
        check_plane(read_scene(plane | {"obstacle": {"shape": "mesh", "surface": text_of(*sound(*CUBE)[:2]), "path": [[0, 5, 0]]}}))


def test_limits_of_a_surface_from_both_sides(monkeypatch):
    points, triangles = CUBE
    assert (module.MOST, module.LARGEST, module.LOOKED_AT, module.FLAT) == (20_000, 1e12, 100, 1e-12)
    assert abs(sound(1e12 * points, triangles)[0]).max() == 1e12
    with pytest.raises(InputError, match=r"not finite or beyond 1e\+12"):
        sound(1.001e12 * points, triangles)
    with pytest.raises(InputError, match="not finite"):
        sound(np.where(points > 0, np.inf, points), triangles)
    for places in (points[:, :2], points.ravel()):
        with pytest.raises(InputError, match="its points are not in space"):
            sound(places, triangles)
    with pytest.raises(InputError, match="names a point that is not there"):
        sound(points, triangles - 1)
    monkeypatch.setattr(module, "MOST", 12)
    text = text_of(*sound(points, triangles)[:2])
    assert len(surface_in(text)[1]) == 12
    monkeypatch.setattr(module, "MOST", 11)
    with pytest.raises(InputError, match="^12 triangles; at most 11: make it coarser"):
        sound(points, triangles)
    surface_in.cache_clear()
    with pytest.raises(InputError, match="its length is not that of its points and triangles"):
        surface_in(text)


def test_a_text_whose_numbers_do_not_fit_is_refused():
    points, triangles, _ = sound(*CUBE)
    body = points.astype("<f8").tobytes() + triangles.astype("<i4").tobytes()

    def text(count, many, rest=body):
        return base64.b64encode(np.array([count, many], "<i4").tobytes() + rest).decode()

    assert len(surface_in(text(8, 12))[0]) == 8
    # As many bytes for more points and fewer triangles, for a number below zero of either, and some too few or too many.
    for count, many, rest in ((-1, 30, body), (20, -12, body), (8, 12, body[:-1]), (8, 12, body + b"0"), (8, 13, body), (9, 12, body)):
        with pytest.raises(InputError, match="^not a surface: its length is not that of"):
            surface_in(text(count, many, rest))
    for count, many in ((9, 10), (7, 14)):
        with pytest.raises(InputError):
            surface_in(text(count, many))
    with pytest.raises(InputError, match="^has no triangles$"):
        surface_in(text(8, 0, body[:8 * 24]))
    with pytest.raises(InputError, match="^not a surface: "):
        surface_in(base64.b64encode(b"1234").decode())


def test_points_keep_their_order_and_zero_has_no_sign():
    points, triangles = CUBE
    spread = np.concatenate([[[7.0, 7, 7]], points[::-1] * [1, 1, -1] + [0, 0, 1]])  # one that is not used, and the others backwards
    back = 8 - triangles
    found, kept, said = sound(np.where(spread == 0, -0.0, spread), back)
    assert np.array_equal(found, spread[1:]) and not np.signbit(found[found == 0]).any()
    turned = kept[:, ::-1] if said else kept
    assert np.array_equal(found[turned], spread[back]) and said == ["12 of 12 triangles looked inwards and have been turned"]


def test_a_triangle_is_flat_below_a_billionth_of_a_thousandth_of_its_longest_side_squared():
    """A tetrahedron whose apex stands above the middle of an edge of 2 by h: its face there has the area h of 4 F at the limit."""
    for h, flat in ((4.1e-12, False), (3.9e-12, True)):
        points = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 1, -1], [0, 0, h]])
        triangles = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
        if flat:
            with pytest.raises(InputError, match=r"^a triangle has no area, at \(0, 0, 1\.3e-12\)$"):
                sound(points, triangles)
        else:
            module._check(points, triangles)  # too thin for anything but this


def test_other_cells_of_a_file_are_passed_over_or_named(tmp_path):
    points, triangles = CUBE
    cells = [("vertex", np.array([[0], [3]])), ("line", np.array([[0, 1]])), ("triangle", triangles)]
    meshio.Mesh(points, cells).write(tmp_path / "a.vtk")
    text, said = read_surface(tmp_path / "a.vtk")
    assert said == "a.vtk" and volume(*surface_in(text)) == pytest.approx(8)
    meshio.Mesh(points, [("triangle", triangles[:, ::-1])]).write(tmp_path / "b.vtk")
    assert read_surface(tmp_path / "b.vtk")[1] == "b.vtk, 12 of 12 triangles looked inwards and have been turned"
    with pytest.raises(InputError, match=r"none\.stl: no such file$"):
        read_surface(tmp_path / "none.stl")
    meshio.Mesh(points, [("line", np.array([[0, 1]]))]).write(tmp_path / "c.vtk")
    with pytest.raises(InputError, match=r"c\.vtk: has no triangles$"):
        read_surface(tmp_path / "c.vtk")


@pytest.mark.parametrize(("place", "expected"), [((0.5, 0.5, 0.5), 1), ((1.5, 0.2, 0.1), 0), ((-0.2, 0.3, 0.9), 0), ((0.01, 0.99, 0.5), 1)])
def test_the_solid_angle_of_a_box_is_all_of_it_from_within_and_nothing_from_without(place, expected):
    points, triangles = brick((0.5, 0.5, 0.5), 0.0, 9.0)
    assert winding(np.array([place]), points + 0.5, triangles) == pytest.approx([expected], abs=1e-13)
    # Of one face alone, seen from the middle: a sixth.
    square = triangles[(points[triangles][:, :, 2] > 0).all(axis=1)]
    assert len(square) == 2 and winding(np.zeros((1, 3)), points, square) == pytest.approx([1 / 6])
