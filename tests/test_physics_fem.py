"""dolfinx's numbering and ours, there and back, and its matrices against closed forms."""

import logging
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx.fem import Function, assemble_scalar
from dolfinx.fem.petsc import create_matrix

from physics import fem
from physics.body.elasticity import Elasticity, small_strain_stiffness
from physics.mesh.build import build_mesh
from physics.scene import Body, Material
from tests.dolfinx_elasticity import assemble_matrix, assemble_vector, conditions

SOLID, PLANE = ("prism", "tetrahedron", "hexahedron"), ("triangle", "quadrilateral")
SIDES = {"length": 0.6, "width": 0.2, "height": 0.5}


def mesh_of(cell):
    if cell in SOLID:
        return build_mesh(Body(**SIDES, cells=(3, 1, 2), cell=cell))
    return build_mesh(Body(shape="plate", length=0.6, width=0.2, cells=(3, 2), cell=cell))


def dense(matrix):
    return matrix.convert("dense").getDenseArray().copy()


@pytest.mark.parametrize("cell", SOLID + PLANE)
def test_every_block_of_unknowns_lies_at_its_node(cell):
    mesh = mesh_of(cell)
    for components in (None, 1):
        space = fem.Space(mesh, components=components)
        D = components or mesh.dimension
        assert space.components == D and space.order == 1 and space.owned == len(mesh.points)
        np.testing.assert_allclose(space.coordinates(), mesh.points[space.nodes], atol=1e-15)
        assert np.array_equal(space.dofs[space.nodes], np.arange(len(mesh.points) * D).reshape(-1, D))
        field = np.arange(len(mesh.points) * D, dtype=float).reshape(-1, D)
        vector = space.to_dofs(field)
        assert all(vector[space.dofs[node, d]] == field[node, d] for node in range(len(field)) for d in range(D))
        assert np.array_equal(space.from_dofs(vector), field) and np.array_equal(space.gather(vector), field)


@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron", *PLANE))
def test_of_second_order_the_corners_are_nodes_and_the_rest_lies_between(cell):
    mesh = mesh_of(cell)
    space = fem.Space(mesh, order=2)
    at, corners = space.coordinates(), space.nodes >= 0
    assert sorted(space.nodes[corners]) == list(range(len(mesh.points)))
    np.testing.assert_allclose(at[corners], mesh.points[space.nodes[corners]], atol=1e-15)
    blocks = len(mesh.points) + len(mesh.edges)  # those of second order lie on edges, of the others on faces and inside too
    assert len(at) == blocks if cell in ("tetrahedron", "triangle") else len(at) > blocks
    inside = space.within(mesh.entities("x-max"))
    assert np.array_equal(inside, abs(at[:, 0] - 0.6) < 1e-9)
    assert np.array_equal(space.within(mesh.entities("x-max y-min")), (abs(at[:, 0] - 0.6) < 1e-9) & (abs(at[:, 1]) < 1e-9))
    assert not space.within({}).any()
    field = space.gather(np.repeat(np.where(corners, space.nodes, -5.0), mesh.dimension))
    assert np.array_equal(field, np.repeat(np.arange(len(mesh.points), dtype=float)[:, None], mesh.dimension, axis=1))


def element_mass(cell, a, b):
    """Integral of N_a N_b over the unit cell: of a line 1/3 and 1/6, of a triangle 1/12 and 1/24, of a tetrahedron 1/60 and 1/120."""
    line = lambda i, j: 1 / 3 if i == j else 1 / 6  # noqa: E731
    if cell == "triangle":
        return 1 / 12 if a == b else 1 / 24
    if cell == "tetrahedron":
        return 1 / 60 if a == b else 1 / 120
    if cell == "prism":
        return (1 / 12 if a % 3 == b % 3 else 1 / 24) * line(a // 3, b // 3)
    around = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    factors = [line(i, j) for i, j in zip(around[a], around[b], strict=True)]
    return np.prod(factors if cell == "hexahedron" else factors[:2])


@pytest.mark.parametrize("cell", SOLID + PLANE)
def test_mass_matrices_are_those_of_the_closed_form(cell):
    """All cells are parallelepipeds or prisms of the same volume, so the unit cell's matrix times det J."""
    mesh, density = mesh_of(cell), 7.0
    share = {"prism": 2, "tetrahedron": 6, "triangle": 2}.get(cell, 1)
    jacobian = {"prism": 2, "tetrahedron": 6, "triangle": 2}.get(cell, 1) * (0.6 * 0.2 * 0.5 if cell in SOLID else 0.6 * 0.2) / 6 / share
    expected = np.zeros((len(mesh.points),) * 2)
    for row in mesh.cells:
        for a, i in enumerate(row):
            for b, j in enumerate(row):
                expected[i, j] += density * jacobian * element_mass(cell, a, b)
    space = fem.Space(mesh)
    u, v = ufl.TrialFunction(space.V), ufl.TestFunction(space.V)
    like = fem.matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2}))
    found = dense(fem.mass_matrix(space, density, like))
    if cell in SOLID:
        fixed = np.zeros(mesh.points.shape, bool)
        elasticity = Elasticity(mesh, Material(young_modulus=1.0, poisson_ratio=0.3, density=density), fixed)
        np.testing.assert_allclose(dense(elasticity.mass()), found, atol=1e-15)
        np.testing.assert_allclose(elasticity.weight(np.array([1.0, -2.0, 3.0])), expected.sum(axis=1)[:, None] * [1, -2, 3], rtol=1e-12)
    D = mesh.dimension
    for i in range(D):
        for j in range(D):
            block = found[np.ix_(space.dofs[:, i], space.dofs[:, j])]
            np.testing.assert_allclose(block, expected if i == j else 0 * expected, atol=1e-12 * expected.max())


def test_the_mass_of_second_order_cells_is_exact():
    """Any quadratic field: integral of x^4 over the box of 0.6 x 0.2 x 0.5 m."""
    for cell in ("tetrahedron", "hexahedron"):
        space = fem.Space(mesh_of(cell), order=2)
        assert space.degrees == ((2, 4) if cell == "tetrahedron" else (5, 5))
        u, v = ufl.TrialFunction(space.V), ufl.TestFunction(space.V)
        mass = fem.mass_matrix(space, 2.0, fem.matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2})))
        field = np.zeros((len(space.coordinates()), 3))
        field[:, 1] = space.coordinates()[:, 0] ** 2
        assert field.ravel() @ dense(mass) @ field.ravel() == pytest.approx(2 * 0.6**5 / 5 * 0.2 * 0.5, rel=1e-12)


def test_degrees_of_quadrature():
    assert fem.Space(mesh_of("prism")).degrees == (2, 4) and fem.Space(mesh_of("tetrahedron")).degrees == (1, 2)
    assert fem.Space(mesh_of("hexahedron")).degrees == (3, 4) and fem.Space(mesh_of("triangle")).degrees == (1, 2)
    assert fem.Space(mesh_of("quadrilateral")).degrees == (3, 4)
    assert fem.Space(mesh_of("triangle"), order=2).degrees == (2, 4) and fem.Space(mesh_of("quadrilateral"), order=2).degrees == (5, 5)


@pytest.mark.parametrize("cell", SOLID)
def test_held_rows_and_columns_are_those_of_the_identity(cell):
    """By our own loops and by dolfinx; whole nodes held, and single components."""
    mesh = mesh_of(cell)
    material = Material(law="linear", young_modulus=1e3, poisson_ratio=0.3)
    for components in ([0, 1, 2], [0, 2]):
        fixed = np.zeros(mesh.points.shape, bool)
        fixed[np.ix_(mesh.places["x-min"], components)] = True
        elasticity = Elasticity(mesh, material, fixed)
        free = dense(Elasticity(mesh, material, np.zeros_like(fixed)).stiffness(np.zeros(mesh.points.shape)))
        np.testing.assert_allclose(free, free.T, atol=1e-12 * abs(free).max())
        held = np.zeros(fixed.size, bool)
        held[elasticity.space.dofs[fixed]] = True
        expected = np.where(held[:, None] | held, np.eye(len(held)), free)
        np.testing.assert_allclose(dense(elasticity.stiffness(np.zeros(mesh.points.shape))), expected, atol=1e-12 * abs(free).max())
        space = elasticity.space
        np.testing.assert_allclose(dense(small_strain_stiffness(space, mesh, material, "standard")), free, atol=1e-12 * abs(free).max())
        u, v = ufl.TrialFunction(space.V), ufl.TestFunction(space.V)
        form = fem.compile_form(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2}))
        masks = np.zeros_like(fixed), fixed
        plain, both = (dense(assemble_matrix(create_matrix(form), form, conditions(space, mask))) for mask in masks)
        np.testing.assert_allclose(both, np.where(held[:, None] | held, np.eye(len(held)), plain), atol=1e-12)


def test_forms_are_assembled_in_numbers_and_arrays():
    mesh = mesh_of("tetrahedron")
    space = fem.Space(mesh)
    u, v = Function(space.V), ufl.TestFunction(space.V)
    assert not u.x.array.any()
    u.x.array[:] = space.to_dofs(mesh.points * [1.0, 0, 0])
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    factor = space.constant(3.0)
    form = fem.compile_form(factor * u[0] * dx)
    assert assemble_scalar(form) == pytest.approx(3 * 0.3 * 0.06, rel=1e-12)  # the mean of x times the volume
    factor.value = 5.0
    assert assemble_scalar(form) == pytest.approx(5 * 0.3 * 0.06, rel=1e-12)
    out = np.full(mesh.points.size, 9.0)  # what was there does not count
    assert assemble_vector(fem.compile_form(v[1] * dx), out) is out
    assert space.from_dofs(out).sum(axis=0) == pytest.approx([0, 0.06, 0], abs=1e-14)


def test_compiled_forms_lie_in_a_folder_of_their_processor(monkeypatch):
    found = fem.cache_folder()
    assert found.parent == Path.home() / ".cache" / "fidelity" and found.name.startswith("forms-") and len(found.name) == 6 + 12
    names = {found}
    for text in ("flags : a b\nflags : x", "flags : a c", "Features : a b", "model : a b"):
        monkeypatch.setattr(Path, "read_text", lambda self, text=text: "model name\t: one\n" + text)
        names.add(fem.cache_folder())
    assert len(names) == 5
    nothing = fem.cache_folder()  # the last has no line of flags

    def fail(self):
        raise FileNotFoundError

    monkeypatch.setattr(Path, "read_text", fail)
    assert fem.cache_folder() == nothing


def test_logs_are_quiet_while_a_form_is_compiled_only():
    with pytest.raises(ValueError), fem._quiet():
        assert not logging.getLogger("any").isEnabledFor(logging.INFO) and logging.getLogger("any").isEnabledFor(logging.WARNING)
        raise ValueError
    assert logging.root.manager.disable == logging.NOTSET


def test_the_c_function_of_a_form_is_cut_out_whole():
    domain, space = fem.tensors()
    F = ufl.Coefficient(space)
    code = fem.cell_function(F[0, 1] * ufl.dx(domain, metadata={"quadrature_degree": 0}))
    assert code.startswith("void tabulate_tensor") and code.endswith("}") and code.count("{") == code.count("}") > 0
    assert F.ufl_shape == (3, 3)
