"""Files that meshio reads: whatever it stumbles over ends in one line with the reason."""

import meshio
import numpy as np
import pytest

from physics.foreign import read_foreign
from physics.schema import InputError

SQUARE = meshio.Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), [("quad", np.array([[0, 1, 2, 3]]))])


def test_a_sound_file_comes_as_meshio_reads_it(tmp_path):
    SQUARE.write(tmp_path / "a.vtk")
    found = read_foreign(tmp_path / "a.vtk")
    assert np.array_equal(found.points, SQUARE.points) and found.cells[0].data.tolist() == [[0, 1, 2, 3]]


@pytest.mark.parametrize("name, content, words", [
    ("a.obj", b"v 0 0 0\nv 1 0 0\n\xff\xfe\x80", "it is cut short or damaged, for it is text up to some place only"),
    ("a.nothing", b"v 0 0 0", "Could not deduce file format from"),
    ("a.vtk", b"", "Illegal VTK header"),
])
def test_what_is_none_is_refused_with_the_reason(tmp_path, capsys, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match="^not a mesh file that meshio can read: [^\n]+$") as refusal:
        read_foreign(tmp_path / name)
    assert words in str(refusal.value)
    assert capsys.readouterr() == ("", "")


TETRAHEDRON = meshio.Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), [("tetra", np.array([[0, 1, 2, 3]]))])


@pytest.mark.parametrize("name, size", [("a.ele", 0), ("a.node", 0), ("a.dat", 180), ("a.mdpa", 150)])
def test_a_file_that_is_cut_short_is_refused_and_not_read_for_ever(tmp_path, name, size):
    """Some of meshio's readers look for the next line behind the end until they are killed."""
    TETRAHEDRON.write(tmp_path / name)
    assert read_foreign(tmp_path / name).cells[0].data.tolist() == [[0, 1, 2, 3]]
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[:size])
    with pytest.raises(InputError, match="it is cut short: it ends where more is expected"):
        read_foreign(tmp_path / name)
