"""Mass matrices: lumped and consistent."""

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, kron


def mass_matrix(assembler, kind):
    """Return the mass matrix (3n, 3n) [kg] on the assembler's pattern.

    assembler : Assembler;  kind : as in `node_mass`
    """
    return onto(assembler.pattern, node_mass(assembler, kind))


def node_mass(assembler, kind):
    """Return the mass matrix (n, n) [kg] that each of the three axes has, sparse.

    assembler : Assembler
    kind : 'lumped' (`Assembler.lumped_mass`) or 'consistent' (integral of rho N_a N_b); carried
        masses stay on the diagonal
    """
    n, body, geometry = assembler.n, assembler.body, assembler.geometry
    if kind == 'lumped':
        return csr_array(diags_array(assembler.lumped_mass()))
    conn = geometry.connectivity
    a = conn.shape[1]
    rows, cols = np.repeat(conn, a, axis=1).ravel(), np.tile(conn, (1, a)).ravel()
    blocks = np.outer(assembler.element_mass(), geometry.mass.ravel()).ravel()
    matrix = coo_array((blocks, (rows, cols)), shape=(n, n))
    carried = np.zeros(n) if body.nodal_mass is None else body.nodal_mass
    return csr_array(matrix.tocsr() + diags_array(carried))


def onto(pattern, scalar):
    """Return a node matrix (n, n), spread to three axes, on a CSR pattern that contains it."""
    indptr, indices = pattern
    full = kron(scalar, np.eye(3), format='coo')
    size = full.shape[0]
    keys = np.repeat(np.arange(size), np.diff(indptr)) * size + indices
    rows, cols = (np.asarray(c, dtype=np.int64) for c in full.coords)
    data = np.zeros(len(indices))
    data[np.searchsorted(keys, rows * size + cols)] = full.data
    return csr_array((data, indices, indptr), shape=full.shape)
