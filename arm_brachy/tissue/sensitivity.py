"""How an equilibrium answers to any parameter: tangent and adjoint solves on one factor.

In equilibrium the forces on the free nodes vanish, f(x, theta) = 0, hence (implicit function
theorem) dx/dtheta = -K^-1 df/dtheta. The forces are linear in shear modulus, bulk modulus, added
stress, nodal force, weight and spring stiffness, so df/dtheta is the force of the *changes* of
these at the same x, without differencing. The adjoint turns the product round: the gradient of
one scalar for all parameters costs one back-solve.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import LinearOperator

from arm_brachy.core.errors import InputError


@dataclass(frozen=True)
class Change:
    """Derivative of a problem with respect to one parameter; None = does not depend on it.

    Units per unit of the parameter.
    mu, kappa : (m,) [Pa];  stress : (m, q, 3, 3) [Pa] as StepFields.stress, symmetric
    nodal_force : (n, 3) [N];  held_at : (n, 3) [m] of the held nodes, other rows are ignored
    gravity : (3,) [m/s^2];  density : (m,) [kg/m^3];  nodal_mass : (n,) [kg] of carried masses
    spring_stiffness : (s, 3, 3) [N/m], rows as `body.springs`
    The shape at rest and which nodes a pad holds are no parameters here: the first needs shape
    derivatives, the second is discrete.
    """

    mu: np.ndarray | None = None
    kappa: np.ndarray | None = None
    stress: np.ndarray | None = None
    nodal_force: np.ndarray | None = None
    held_at: np.ndarray | None = None
    gravity: np.ndarray | None = None
    density: np.ndarray | None = None
    nodal_mass: np.ndarray | None = None
    spring_stiffness: np.ndarray | None = None


@dataclass(frozen=True)
class Response:
    """Derivatives of a solution with respect to k parameters, units per unit of the parameter.

    x : (n, 3, k) [m];  pad_force : (p, 3, k) [N] of the tissue ON each pad
    """

    x: np.ndarray
    pad_force: np.ndarray

    def points(self, embedding):
        """Return the derivatives (e, 3, k) [m] of the positions of embedded points.

        embedding : mesh.Embedding of e points
        """
        return np.einsum('ea,eaik->eik', embedding.weights, self.x[embedding.nodes])


@dataclass(frozen=True)
class Gradient:
    """Derivatives of one scalar, of unit J, with respect to everything; fields as in `Change`.

    mu, kappa : (m,) [J/Pa];  nodal_force : (n, 3) [J/N], the adjoint state, zero at fixed nodes
    held_at : (n, 3) [J/m], zero at free nodes;  gravity : (3,) [J s^2/m]
    density : (m,) [J m^3/kg];  nodal_mass : (n,) [J/kg]
    spring_stiffness : (s, 3, 3) [J m/N], symmetric: to be contracted with symmetric changes
    Added stress is not among them; `along` takes it.
    """

    mu: np.ndarray
    kappa: np.ndarray
    nodal_force: np.ndarray
    held_at: np.ndarray
    gravity: np.ndarray
    density: np.ndarray
    nodal_mass: np.ndarray
    spring_stiffness: np.ndarray


def respond(linearisation, changes):
    """Return the Response to k parameters: k back-solves with one factor, done together.

    linearisation : jacobian.Linearisation;  changes : k Changes
    Raises InputError for an array of the wrong shape. First order: for a change h off by O(h^2).
    """
    motion, rate = _right_hand_sides(linearisation, changes)
    dx = linearisation.respond(motion, rate)
    return Response(dx.reshape(*linearisation.x.shape, len(changes)),
                    linearisation.pad_force_change(dx, rate))


def gradient(linearisation, x_bar=None, pad_force_bar=None):
    """Return the Gradient of a scalar J(x, pad force) for all parameters, by one back-solve.

    linearisation : jacobian.Linearisation
    x_bar : (n, 3) [J/m] dJ/dx, None = 0;  pad_force_bar : (p, 3) [J/N] dJ/d pad_force, None = 0
    For J of embedded points: x_bar = embedding.matrix(n).T @ dJ/d points.
    Raises InputError for an array of the wrong shape.
    With the adjoint state a, dJ/dmu_e = -a_e . df_e/dmu_e, the force of element e with unit
    shear modulus and no other; likewise for the others.
    """
    a, held = _adjoint(linearisation, x_bar, pad_force_bar)
    assembler, body = linearisation.solver.assembler, linearisation.solver.body
    mu, kappa = np.split(-moduli_derivative(linearisation).T @ a.ravel(), 2)
    springs, pulled = body.springs.nodes, a @ body.gravity
    stretch = (linearisation.x - body.mesh.nodes)[springs] - linearisation.fields.base
    dyad = -np.einsum('si,sj->sij', a[springs], stretch)
    return Gradient(
        mu=mu, kappa=kappa, nodal_force=a, held_at=held,
        gravity=assembler.heavy_mass(body.density, body.nodal_mass) @ a,
        density=np.einsum('ma,ma->m', _share(assembler), pulled[assembler.geometry.connectivity]),
        nodal_mass=pulled, spring_stiffness=0.5 * (dyad + np.swapaxes(dyad, 1, 2)))


def along(linearisation, changes, x_bar=None, pad_force_bar=None):
    """Return dJ/d parameter (k,) for k Changes by one back-solve, any field of them.

    linearisation, changes : as in `respond`;  x_bar, pad_force_bar : as in `gradient`
    The transpose of `respond`: in a least-squares fit of k parameters, J' times the residuals.
    """
    a, held = _adjoint(linearisation, x_bar, pad_force_bar)
    motion, rate = _right_hand_sides(linearisation, changes)
    return held.ravel() @ motion - a.ravel() @ rate


def moduli_derivative(linearisation):
    """Return d forces / d (mu, kappa) of all elements at fixed x, sparse (3n, 2m) [N/Pa].

    linearisation : jacobian.Linearisation, for its x.  Columns: mu, then kappa, by element
    Column e is the force of element e with unit modulus, exact since forces are linear in it.
    """
    state = linearisation.solver.assembler, linearisation.x, linearisation.fields
    one, none = np.ones(len(linearisation.fields.mu)), np.zeros(len(linearisation.fields.mu))
    return _by_element(state[0], np.concatenate([_element_forces(*state, one, none),
                                                 _element_forces(*state, none, one)]))


def log_modulus_derivative(assembler, x, fields):
    """Return d forces / d log E of every element at fixed x, its ratio kept, sparse (3n, m) [N].

    assembler : assembly.Assembler;  x : (n, 3) [m];  fields : StepFields, for its moduli
    Column e is what element e bears by its moduli, without stiffening, fibres and added stress.
    """
    return _by_element(assembler, _element_forces(assembler, x, fields, fields.mu, fields.kappa))


def moduli_operator(linearisation, embedding):
    """Return d (points, pad forces) / d (mu, kappa) of all elements, as a LinearOperator.

    linearisation : jacobian.Linearisation, not moved afterwards
    embedding : mesh.Embedding of e points
    Shape (3 e + 3 p, 2 m): rows are the points' coordinates [m], then the pad forces [N]; columns
    mu, then kappa [Pa]. A @ v and A.T @ w cost one back-solve each, so Gauss-Newton steps on
    every element need no matrix; scale rows by the sensors' noise and columns by the prior.
    """
    n, pads = linearisation.solver.assembler.n, len(linearisation.solver.body.pads)
    weights, by_moduli = embedding.matrix(n), moduli_derivative(linearisation)
    split, still = 3 * len(embedding.nodes), np.zeros((3 * n, 1))

    def times(v):
        rate = (by_moduli @ v.ravel())[:, None]
        dx = linearisation.respond(still, rate)
        return np.concatenate([(weights @ dx.reshape(n, 3)).ravel(),
                               linearisation.pad_force_change(dx, rate).ravel()])

    def transposed(w):
        x_bar = weights.T @ w.ravel()[:split].reshape(-1, 3)
        a, _ = linearisation.adjoint(x_bar.reshape(-1, 1), w.ravel()[split:, None])
        return -(by_moduli.T @ a).ravel()

    return LinearOperator((split + 3 * pads, by_moduli.shape[1]), matvec=times,
                          rmatvec=transposed, dtype=float)


def log_modulus(fields, elements=None):
    """Return the Change with the logarithm of Young's modulus at constant Poisson's ratio.

    fields : StepFields in force;  elements : (k,) those that share it, None = all
    Stiffening and fibres do not change with it.
    """
    where = _indicator(len(fields.mu), elements)
    return Change(mu=fields.mu * where, kappa=fields.kappa * where)


def poisson_ratio(fields, nu, elements=None):
    """Return the Change with Poisson's ratio at constant Young's modulus (below 3.18).

    fields, elements : as in `log_modulus`;  nu : their ratio now, below 1/2
    d mu / d nu = -mu / (1 + nu),  d kappa / d nu = 2 kappa / (1 - 2 nu)
    """
    where = _indicator(len(fields.mu), elements)
    return Change(mu=-fields.mu * where / (1.0 + nu),
                  kappa=2.0 * fields.kappa * where / (1.0 - 2.0 * nu))


def pad_motion(linearisation, velocity, spin):
    """Return the Change with a rigid motion of pads: how they were registered, or slip in place.

    linearisation : jacobian.Linearisation
    velocity : (p, 3) [m] of each disc's centre;  spin : (p, 3) [rad] about that centre, which has
        moved with the mean of its nodes. A pad that is glued to other nodes is beyond it.
    """
    body, x = linearisation.solver.body, linearisation.x
    held_at = np.zeros_like(x)
    for pad, v, turn in zip(body.pads, velocity, spin, strict=True):
        now = x[pad.nodes]
        centre = pad.centre + (now - body.mesh.nodes[pad.nodes]).mean(axis=0)
        held_at[pad.nodes] = v + np.cross(turn, now - centre)
    return Change(held_at=held_at)


def _indicator(m, elements):
    where = np.ones(m)
    if elements is not None:
        where[:] = 0.0
        where[elements] = 1.0
    return where


def _adjoint(linearisation, x_bar, pad_force_bar):
    """Adjoint state and gradient for the held positions, both (n, 3)."""
    body = linearisation.solver.body
    x_bar = _checked('x_bar', x_bar, linearisation.x.shape)
    pad_bar = _checked('pad_force_bar', pad_force_bar, (len(body.pads), 3))
    a, held = linearisation.adjoint(x_bar.reshape(-1, 1), pad_bar.reshape(-1, 1))
    return a.reshape(-1, 3), held.reshape(-1, 3)


def _right_hand_sides(linearisation, changes):
    """Motion of held nodes and change of `Assembler.forces` at fixed x, both (3n, k)."""
    shape, m = linearisation.x.shape, len(linearisation.fields.mu)
    motion, rate = np.zeros((2, linearisation.x.size, len(changes)))
    moduli = np.zeros((2 * m, len(changes)))
    for k, change in enumerate(changes):
        motion[:, k] = _checked('held_at', change.held_at, shape).ravel()
        rate[:, k] = _load_change(linearisation, change).ravel()
        moduli[:m, k] = _checked('mu', change.mu, (m,))
        moduli[m:, k] = _checked('kappa', change.kappa, (m,))
    if moduli.any():
        rate += moduli_derivative(linearisation) @ moduli
    return motion, rate


def _load_change(linearisation, change):
    """Change (n, 3) of `Assembler.forces` at fixed x, save by moduli."""
    assembler, body = linearisation.solver.assembler, linearisation.solver.body
    m, n, springs = len(body.mu), assembler.n, body.springs
    rate = -_checked('nodal_force', change.nodal_force, (n, 3))
    if change.stress is not None:
        no = np.zeros(m)
        rate += _nodal(assembler, _element_forces(assembler, linearisation.x,
                                                  linearisation.fields, no, no, change.stress))
    if change.gravity is not None:
        mass = assembler.heavy_mass(body.density, body.nodal_mass)
        rate -= np.outer(mass, _checked('gravity', change.gravity, (3,)))
    if not (change.density is None and change.nodal_mass is None):
        mass = assembler.heavy_mass(_checked('density', change.density, (m,)),
                                    _checked('nodal_mass', change.nodal_mass, (n,)))
        rate -= np.outer(mass, body.gravity)
    if change.spring_stiffness is not None:
        stiffness = _checked('spring_stiffness', change.spring_stiffness, springs.stiffness.shape)
        stretch = (linearisation.x - body.mesh.nodes)[springs.nodes] - linearisation.fields.base
        rate[springs.nodes] += np.einsum('sij,sj->si', stiffness, stretch)
    return rate


def _element_forces(assembler, x, fields, mu, kappa, stress=None):
    """Forces (m, a, 3) of every element alone, by these moduli and this stress, nothing else."""
    stress = _checked('stress', stress, fields.stress.shape)
    only = replace(fields, mu=mu, kappa=kappa, beyond=np.zeros_like(fields.beyond),
                   stress=stress)
    return assembler.element_forces(x, only)


def _by_element(assembler, parts):
    """Sparse (3n, k) of forces (k, a, 3) of the elements, in their order, once or again."""
    conn = assembler.geometry.connectivity
    rows = (3 * conn[:, :, None] + np.arange(3)).ravel()
    return csc_array((parts.ravel(), np.tile(rows, len(parts) // len(conn)),
                      rows.size // len(conn) * np.arange(len(parts) + 1)),
                     shape=(3 * assembler.n, len(parts)))


def _nodal(assembler, parts):
    """Sum (n, ...) over the elements of `parts` (m, a, ...), in a fixed order."""
    conn = assembler.geometry.connectivity.ravel()
    columns = parts.reshape(len(conn), -1).T
    total = np.column_stack([np.bincount(conn, c, minlength=assembler.n) for c in columns])
    return total.reshape(assembler.n, *parts.shape[2:])


def _share(assembler):
    """Integrals (m, a) [m^3] of the shape functions, by which gravity pulls on the nodes."""
    return assembler.geometry.weights @ assembler.geometry.shape


def _checked(name, value, shape):
    """`value` as an array of `shape`, zeros for None; raises InputError."""
    if value is None:
        return np.zeros(shape)
    value = np.ascontiguousarray(value, dtype=float)
    if value.shape != shape:
        raise InputError(f'{name} has shape {value.shape}; must be {shape}, as in '
                         'sensitivity.Change')
    return value
