"""Closed surfaces of triangles, written down or put together from outlines, as tools that press a body."""

import base64

import meshio
import numpy as np

from physics.contact.surfaces import box, capped, rounded

# A spanner seen from above [mm]: a handle that ends in a jaw open to the right, counter-clockwise.
SPANNER = np.array([(-60, -5), (-6, -5), (0, -11), (12, -11), (14, -5), (5, -5),
                    (5, 5), (14, 5), (12, 11), (0, 11), (-6, 5), (-60, 5)], float)
# Its triangles, by the numbers of the outline.
INSIDE = np.array([(0, 1, 10), (0, 10, 11), (1, 5, 10), (5, 6, 10), (1, 2, 5), (2, 3, 5), (3, 4, 5), (6, 9, 10), (6, 8, 9), (6, 7, 8)])


def extruded(outline, inside, height):
    """The surface of a plate: an outline (P, 2), counter-clockwise, with its triangles inside, from z = 0 up to a height."""
    n, i = len(outline), np.arange(len(outline))
    j = (i + 1) % n
    points = np.concatenate([np.pad(outline, ((0, 0), (0, 1))), np.pad(outline, ((0, 0), (0, 1)), constant_values=height)])
    points[:n, 2] = 0.0
    sides = np.concatenate([np.stack([i, j, j + n], axis=1), np.stack([i, j + n, i + n], axis=1)])
    return points, np.concatenate([inside[:, ::-1], inside + n, sides])


def spanner(height=6.0):
    points, triangles = extruded(SPANNER, INSIDE, height)
    return points - [0, 0, height / 2], triangles


def ball(radius, size):
    return capped(radius, 0.0, size)


def brick(half, radius, size):
    half = np.array(half, float)
    return rounded(*box(half, size), half, radius)


def written(path, surface):
    """The name of a file that holds a surface; its ending says which format."""
    points, triangles = surface
    meshio.Mesh(points, [("triangle", triangles)]).write(path)
    return str(path)


def text_of(points, triangles):
    """A surface as a scene holds it."""
    head = np.array([len(points), len(triangles)], "<i4")
    return base64.b64encode(head.tobytes() + np.asarray(points, "<f8").tobytes() + np.asarray(triangles, "<i4").tobytes()).decode()
