"""Stiffness, mass and loads of elastic bodies on the free displacement dofs.

Clamped dofs are taken out of the matrices, so that they leave no spurious eigenvalue behind.
Second-order elements by default: linear ones lock in bending.
"""

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray

from brake_fenicsx import compat
from brake_fenicsx.arguments import AnyArray, Ints
from brake_fenicsx.errors import OfOneProcess, SceneError
from brake_fenicsx.meshing.brake_mesh import Mesh

from .material import Material
from .solver import whole

COMPONENTS = {"x": 0, "y": 1, "z": 2}
# 27 points integrate a second-order hexahedron; UFL's own estimate takes many more.
QUADRATURE = {"tetrahedron": {}, "hexahedron": {"quadrature_degree": 4}}


def epsilon(u: Any) -> Any:
    """Small strain as a Voigt vector with engineering shears, Eq. (2)."""
    e = ufl.sym(ufl.grad(u))
    return ufl.as_vector([e[0, 0], e[1, 1], e[2, 2], 2 * e[1, 2], 2 * e[0, 2], 2 * e[0, 1]])


def sigma(u: Any, C: Any) -> Any:
    """Hooke's law: Cauchy stress C : epsilon(u) as a Voigt vector [Pa], Eq. (3).

    Args:
        u: displacement [m].
        C: stiffness [Pa], shape (6, 6).
    """
    return C * epsilon(u)


def stiffness_form(u: Any, v: Any, C: Any, dx: Any) -> Any:
    """Virtual work of the solids: the part of the stresses, Eq. (13)."""
    return ufl.inner(sigma(u, C), epsilon(v)) * dx


def mass_form(u: Any, v: Any, rho: Any, dx: Any) -> Any:
    """Virtual work of inertia, rho u''; it enters with the complex modes alone."""
    return rho * ufl.inner(u, v) * dx


def pressure_form(v: Any, n: Any, pressure: Any, ds: Any) -> Any:
    """Virtual work of the solids: the part of a pressure on a boundary face, Eq. (13)."""
    return -pressure * ufl.inner(n, v) * ds


@dataclass(frozen=True, slots=True)
class FaceAddition:
    """What is added to the bodies on a face, spread evenly over its area.

    Attributes:
        face: name of the face.
        stiffness: total of the springs to the ground, in x, y, z axes [N/m], shape (3, 3).
        mass: total [kg].
        bedding: stiffness per area [Pa/m], beside it, likewise.
        damping: total of dashpots to the ground [N s/m], likewise.
    """

    face: str
    stiffness: AnyArray
    mass: float
    bedding: AnyArray = field(default_factory=lambda: np.zeros((3, 3)))
    damping: AnyArray = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True, slots=True)
class FreeDofs(OfOneProcess):
    """Numbering of the displacement dofs that are not held.

    Attributes:
        V: vector function space.
        local: the free ones among all dofs of the mesh, in their order.
        column: free number of every dof of the mesh; -1 where held.
        size: number of free dofs, with coordinates of bodies given by matrices, which follow those
            of the mesh.
        places: coordinates [m] and direction (0, 1, 2; 3: none) of those that follow, and the
            number of their body, shape (size - len(local), 5).
    """

    V: Any
    local: NDArray[np.int32]
    column: Ints
    size: int
    places: AnyArray = field(default_factory=lambda: np.zeros((0, 5)))

    def expand(self, x: AnyArray) -> AnyArray:
        """Values on all dofs of the mesh, zero where held.

        Args:
            x: free vector, shape (free dofs,), or (free dofs, m).

        Returns:
            Shape (dofs, ...).
        """
        full = np.zeros((self.column.size, *x.shape[1:]), dtype=x.dtype)
        full[self.local] = x[: self.local.size]
        return full


@dataclass(frozen=True, slots=True)
class Elastic:
    """Assembled elastic bodies.

    Attributes:
        K: stiffness [N/m] on the free dofs.
        M: mass [kg] on the free dofs.
        free: the numbering.
        C: damping of springs and of bodies given by matrices [N s/m]; None where there is none.
        sets: sets of nodes of bodies given by matrices -> their displacements, node by node in x,
            y, z, shape (3 nodes, free dofs).
        masses: bodies given by matrices -> their mass [kg] on all free dofs.
        doubts: what is unlikely of such bodies.
        bodies: bodies given by matrices -> mass [kg] and sides of the box around the nodes [m].
    """

    K: sp.csr_matrix
    M: sp.csr_matrix
    free: FreeDofs
    C: sp.csr_matrix | None = None
    sets: dict[str, sp.csr_matrix] = field(default_factory=dict)
    masses: dict[str, sp.csr_matrix] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()
    bodies: dict[str, tuple[float, tuple[float, ...]]] = field(default_factory=dict)


def free_dofs(mesh: Mesh, V: Any, supports: Mapping[str, list[str]]) -> FreeDofs:
    """Number the dofs that no support holds.

    Args:
        mesh: the tagged mesh.
        V: vector function space on it.
        supports: face name -> held components, of "x", "y", "z".

    Returns:
        The numbering.
    """
    index_map, bs = V.dofmap.index_map, V.dofmap.index_map_bs
    held = np.zeros((index_map.size_local, bs), dtype=bool)
    for face, components in supports.items():
        facets = mesh.facet_tags.find(face_tag(mesh, face, "supports"))
        blocks = fem.locate_dofs_topological(V, mesh.domain.topology.dim - 1, facets)
        for c in components:
            held[blocks, COMPONENTS[c]] = True
    held = held.reshape(-1)
    local = np.flatnonzero(~held).astype(np.int32)
    column = np.full(held.size, -1, dtype=np.int64)
    column[local] = np.arange(local.size)
    return FreeDofs(V, local, column, local.size)


def layer_measure(mesh: Mesh, layer: str) -> Any:
    """Integral over the cells of a layer.

    Args:
        mesh: the tagged mesh.
        layer: "part.layer".
    """
    cells = compat.meshtags(mesh.domain, 3, mesh.cell_tags.find(mesh.layers[layer]), 1)
    rule = QUADRATURE[mesh.shape]
    return ufl.Measure("dx", domain=mesh.domain, subdomain_data=cells, metadata=rule)(1)


def face_tag(mesh: Mesh, face: str, where: str) -> int:
    """Tag of a named face.

    Raises:
        SceneError: no part has such a face; the message lists those there are.
    """
    if face not in mesh.faces:
        raise SceneError(f"{where}: no face {face!r}; there are {', '.join(sorted(mesh.faces))}")
    return mesh.faces[face]


def assemble_elastic(
    mesh: Mesh,
    materials: Mapping[str, Material],
    supports: Mapping[str, list[str]],
    degree: int = 2,
    added: Sequence[FaceAddition] = (),
    lumped: bool = False,
) -> Elastic:
    """Assemble stiffness, mass and loads of all bodies.

    Args:
        mesh: the tagged mesh.
        materials: layer name -> material in x, y, z axes.
        supports: face name -> held components.
        degree: polynomial degree of the displacement.
        added: springs and masses on faces.
        lumped: whether each row of the mass is summed on its diagonal; of degree 1 alone.

    Returns:
        Matrices and load vector on the free dofs.

    Raises:
        SceneError: a layer without material, an unknown face, or a PETSc of complex scalars.
    """
    compat.require_real_petsc()
    V = compat.vector_space(mesh.domain, degree)
    free = free_dofs(mesh, V, supports)
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    K = M = None
    for layer in mesh.layers:
        if layer not in materials:
            raise SceneError(f"layer {layer!r} has no material")
        dx = layer_measure(mesh, layer)
        C = fem.Constant(mesh.domain, materials[layer].C)
        rho = fem.Constant(mesh.domain, PETSc.ScalarType(materials[layer].rho))
        if K is None:
            everywhere = ufl.Measure("dx", domain=mesh.domain, metadata=QUADRATURE[mesh.shape])
            whole = fem.form(mass_form(u, v, rho, everywhere))
            K, M = fem_petsc.create_matrix(whole), fem_petsc.create_matrix(whole)
        fem_petsc.assemble_matrix(K, fem.form(stiffness_form(u, v, C, dx)))
        fem_petsc.assemble_matrix(M, fem.form(mass_form(u, v, rho, dx)))
    if K is None or M is None:
        raise SceneError("the scene has no part")
    dashpots = None
    for one in added:
        ds = _face(mesh, one.face, "springs and masses")
        area = measured_area(mesh, ds)
        k = fem.Constant(mesh.domain, one.stiffness / area + one.bedding)
        c = fem.Constant(mesh.domain, one.damping / area)
        if k.value.any():
            fem_petsc.assemble_matrix(K, fem.form(ufl.inner(ufl.dot(k, u), v) * ds))
        if c.value.any():
            A = fem_petsc.assemble_matrix(fem.form(ufl.inner(ufl.dot(c, u), v) * ds))
            part = on_free_dofs(A, free)
            dashpots = part if dashpots is None else dashpots + part
    mass = _mass(M, free, lumped)
    for one in added:
        if one.mass:
            mass = mass + one.mass * face_mass(mesh, free, one.face, lumped)
    return Elastic(on_free_dofs(K, free), mass, free, dashpots)


def face_mass(mesh: Mesh, free: FreeDofs, face: str, lumped: bool = False) -> sp.csr_matrix:
    """Mass of 1 kg that is spread evenly over a named face, on the free dofs [-]."""
    u, v = ufl.TrialFunction(free.V), ufl.TestFunction(free.V)
    ds = _face(mesh, face, "masses")
    m = fem.Constant(mesh.domain, PETSc.ScalarType(1 / measured_area(mesh, ds)))
    return _mass(fem_petsc.assemble_matrix(fem.form(mass_form(u, v, m, ds))), free, lumped)


def layer_masses(
    mesh: Mesh, free: FreeDofs, density: Mapping[str, float], lumped: bool = False
) -> dict[str, sp.csr_matrix]:
    """Mass matrices of single layers: what the kinetic energy of a mode is shared out by.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        density: layer -> density [kg/m^3].
        lumped: whether each row is summed on the diagonal.

    Returns:
        Layer -> mass [kg] on the free dofs of all parts; they add up to the mass.
    """
    u, v = ufl.TrialFunction(free.V), ufl.TestFunction(free.V)
    masses = {}
    for layer, value in density.items():
        rho = fem.Constant(mesh.domain, PETSc.ScalarType(value))
        form = fem.form(mass_form(u, v, rho, layer_measure(mesh, layer)))
        masses[layer] = _mass(fem_petsc.assemble_matrix(form), free, lumped)
    return masses


def _mass(M: PETSc.Mat, free: FreeDofs, lumped: bool) -> sp.csr_matrix:
    """A mass on the free dofs, each row summed on its diagonal if wanted."""
    M.assemble()
    if lumped:
        rows = M.createVecLeft()
        M.getRowSum(rows)
        M.zeroEntries()
        # The mass of one layer has no places for the dofs of others.
        M.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        M.setDiagonal(rows)
        rows.destroy()
    found = on_free_dofs(M, free)
    # The components of a displacement share no mass, and PETSc keeps places for all layers.
    found.eliminate_zeros()
    return found


def face_area(mesh: Mesh, face: str) -> float:
    """Area of a named face [m^2]."""
    return measured_area(mesh, _face(mesh, face, "loads"))


def on_free_dofs(A: PETSc.Mat, free: FreeDofs) -> sp.csr_matrix:
    """Rows and columns of the free dofs of a matrix of all, which is destroyed."""
    A.assemble()
    keep = PETSc.IS().createGeneral(free.local, comm=A.comm)
    part = A.createSubMatrix(keep, keep)
    A.destroy()
    found = whole(part)
    part.destroy()
    found.resize(free.size, free.size)
    return found


def affine_parts(
    mesh: Mesh, free: FreeDofs, directions: Sequence[Mapping[str, AnyArray]]
) -> list[sp.csr_matrix]:
    """Stiffness of unit changes of the materials: K is linear in every C_ij.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        directions: for each matrix wanted, layer name -> change of its stiffness in x, y, z axes
            [Pa], shape (6, 6), symmetric; other layers do not change.

    Returns:
        One matrix [N/m] on the free dofs for each direction.
    """
    u, v = ufl.TrialFunction(free.V), ufl.TestFunction(free.V)
    parts = []
    for changes in directions:
        total = None
        for layer, change in changes.items():
            C = fem.Constant(mesh.domain, change)
            form = fem.form(stiffness_form(u, v, C, layer_measure(mesh, layer)))
            # The pattern is that of the layer's own cells: each has a matrix of its own.
            part = on_free_dofs(fem_petsc.assemble_matrix(form), free)
            total = part if total is None else total + part
        if total is None:
            raise SceneError("a change of no layer")
        parts.append(total)
    return parts


def stiffness_action(
    mesh: Mesh, free: FreeDofs, materials: Mapping[str, Material], displacement: AnyArray
) -> AnyArray:
    """Nodal forces [N] of a displacement on all dofs of the mesh, held ones included.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        materials: layer name -> material in x, y, z axes.
        displacement: on all dofs of the mesh [m].
    """
    u, v = fem.Function(free.V), ufl.TestFunction(free.V)
    u.x.array[:] = displacement
    total = np.zeros_like(displacement)
    for layer in mesh.layers:
        dx = layer_measure(mesh, layer)
        C = fem.Constant(mesh.domain, materials[layer].C)
        b = fem_petsc.assemble_vector(fem.form(stiffness_form(u, v, C, dx)))
        total += b.array_r
        b.destroy()
    return total


def unit_loads(mesh: Mesh, free: FreeDofs, face: str) -> AnyArray:
    """Loads [N/Pa] of a pressure of 1 Pa on a face, on the free dofs."""
    ds = _face(mesh, face, "loads")
    v, n = ufl.TestFunction(free.V), ufl.FacetNormal(mesh.domain)
    one = fem.Constant(mesh.domain, PETSc.ScalarType(1.0))
    b = fem_petsc.assemble_vector(fem.form(pressure_form(v, n, one, ds)))
    f = np.zeros(free.size)
    f[: free.local.size] = b.array_r[free.local]
    b.destroy()
    return f


def _face(mesh: Mesh, face: str, where: str) -> Any:
    """Measure of a named face."""
    facets = mesh.facet_tags.find(face_tag(mesh, face, where))
    tags = compat.meshtags(mesh.domain, 2, facets, 1)
    return ufl.Measure("ds", domain=mesh.domain, subdomain_data=tags)(1)


def measured_area(mesh: Mesh, ds: Any) -> float:
    """Area of a face [m^2]."""
    one = fem.Constant(mesh.domain, PETSc.ScalarType(1.0))
    return float(fem.assemble_scalar(fem.form(one * ds)))
